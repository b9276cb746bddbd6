//! From the mapped drawing to the marks: the optics, the corrected drawing and its fill, and whether the beam, the focus and
//! the axis reach it.

pub mod marking;
mod chords;
pub mod optics;
pub mod correction;
mod exposure;
pub mod sensitivity;
pub mod shadow;
pub mod frame_outline;
pub mod fill;
pub mod focus;
pub mod rotary;
pub mod belt;
