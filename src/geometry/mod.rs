//! Pure mathematics: values in, values out. No file, clock, thread, log or file format is used here.
//!
//! It is a crate for itself, which the crate `isomark` shows as its module `geometry`.
//!
//! Lengths are in mm and angles in rad. Each frame has its own point type ([`space`]).

// Paths start at the root of all rooms, here as elsewhere.
use crate as geometry;

pub mod space;
pub mod mesh;
pub mod point_cloud;
mod adjacency;
pub mod winding;
pub mod noise;
pub mod holes;
mod chord_normals;
mod shape_fit;
pub mod cylinder;
pub mod smooth_mesh;
mod osculating_jet;
mod flats;
pub mod shading;
pub mod flat_shading;
pub mod curved_triangle;
pub mod solid;
pub mod height_field;
pub mod normal_equations;
pub mod surface;
pub mod pattern;
pub mod contour;
pub mod ink;
pub mod relief;
mod chords;
pub mod close_lines;
pub mod distances;
mod divided;
pub mod ink_mesh;
pub mod mapping;
pub mod primitive;
pub mod marking;
pub mod optics;
pub mod correction;
mod exposure;
pub mod sensitivity;
pub mod shadow;
pub mod frame_outline;
pub mod fill;
pub mod focus;
pub mod mark_region;
pub mod rotary;
pub mod belt;
pub mod sides;
pub mod rims;
pub mod silhouette;
pub mod picture_mesh;
pub mod shapes;
