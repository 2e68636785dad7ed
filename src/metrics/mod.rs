//! Scores of surface models against lidar.
