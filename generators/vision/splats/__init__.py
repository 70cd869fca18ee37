"""Captured 3D Gaussians ("splats") as pictures, with inserted objects among them."""
