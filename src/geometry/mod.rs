//! Pure mathematics: values in, values out. No file, clock, thread, log or file format is used here.
//!
//! It is a separate crate, which the crate `isomark` shows as its module `geometry`.
//!
//! Lengths are in mm and angles in rad. Each frame has its own point type ([`space`]).
//!
//! The rooms, in the order in which a job passes them: `part` (what the file describes, and the heights that the laser sees),
//! [`surface`] (the fit), `drawing` (paths and ink), [`mapping`] (the length-true map), `laser` (the corrected drawing, and what
//! the machine can mark).

// Paths start at the root of all rooms, here as elsewhere.
use crate as geometry;

pub mod space;
pub mod fork;
mod part;
pub mod normal_equations;
pub mod surface;
mod drawing;
pub mod relief;
mod divided;
pub mod mapping;
pub mod primitive;
mod laser;
pub mod picture_mesh;
pub mod shapes;

pub use drawing::{close_lines, contour, distances, ink, ink_mesh, pattern};
pub use laser::{belt, correction, fill, focus, frame_outline, marking, optics, rotary, sensitivity, shadow};
use part::{adjacency, disjoint_sets, faces, flats, osculating_jet, rounding, shape_fit, sphere};
pub use part::{
    chord_normals, cone, cracks, curved_triangle, cylinder, facing_part, flat_shading, height_field, holes,
    mark_region, mesh, noise, point_cloud, polygons, regions, rims, shading, sides, silhouette, smooth_mesh,
    solid, winding,
};
