"""`avs3d export seld`: recordings and labels as data sets of sound event localisation and detection have them."""
