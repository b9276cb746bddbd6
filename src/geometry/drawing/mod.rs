//! The drawing: its paths, its closed contours, and the ink that is measured.

pub mod pattern;
pub mod contour;
pub mod ink;
pub mod close_lines;
pub mod distances;
pub mod ink_mesh;
