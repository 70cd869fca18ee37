"""A home with objects placed in it: its light at each second, poses that look at the objects, pictures and sound."""
