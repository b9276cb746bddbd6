//! From the drawing's plane onto the part.
//!
//! All lengths can be kept only where the Gaussian curvature is zero (Gauss, Theorema Egregium, 1827); elsewhere
//! [`quality`] says how far lengths, areas and angles move.

pub mod isometric;
pub mod quality;
