//! The part's surface: knots, NURBS, and its fit to a height field.

pub mod knots;
pub mod nurbs;
pub mod fit;
pub mod scan;
