//! Pure mathematics: values in, values out. No file, clock, thread, log or format is known here.
//!
//! Lengths are in mm and angles in rad. Frames are told apart by their types ([`space`]).

pub mod space;
pub mod mesh;
pub mod point_cloud;
mod adjacency;
pub mod winding;
pub mod smooth_mesh;
mod osculating_jet;
mod flats;
pub mod shading;
pub mod curved_triangle;
pub mod height_field;
pub mod normal_equations;
pub mod surface;
pub mod pattern;
pub mod contour;
pub mod ink;
pub mod mapping;
pub mod primitive;
pub mod marking;
pub mod optics;
pub mod correction;
pub mod shapes;
