"""Homes from files: HM3D, Matterport3D, or any mesh."""
