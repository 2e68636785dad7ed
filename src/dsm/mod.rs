//! From splats to georeferenced rasters.
