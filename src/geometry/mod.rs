//! Pure mathematics: values in, values out. No file, clock, thread, log or format is known here.

pub mod space;
pub mod mesh;
pub mod pattern;
pub mod contour;
pub mod marking;
