//! The part as its file describes it: a mesh, points or CAD faces, and the heights that the laser sees of it.

pub mod mesh;
pub mod point_cloud;
pub(crate) mod disjoint_sets;
pub(crate) mod adjacency;
pub mod polygons;
pub mod winding;
pub(crate) mod rounding;
pub mod noise;
pub mod holes;
pub mod chord_normals;
pub(crate) mod shape_fit;
pub mod cylinder;
pub mod cone;
pub mod smooth_mesh;
pub(crate) mod osculating_jet;
pub(crate) mod flats;
pub mod shading;
pub mod flat_shading;
pub mod curved_triangle;
pub mod solid;
pub mod height_field;
pub mod regions;
pub mod mark_region;
pub mod sides;
pub mod rims;
pub mod silhouette;
