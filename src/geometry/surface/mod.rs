//! The part's surface: knots, NURBS, its nearest points, and its fit to a height field.

pub mod knots;
pub mod nurbs;
pub mod closest;
pub mod fit;
pub mod scan;
