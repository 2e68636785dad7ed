//! Affine cameras in the site frame: views, suns and virtual cameras.
