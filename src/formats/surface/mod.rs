//! Fitted surfaces to bytes that CAD opens, in the part's own frame and mm, so that they lie on the part they stand for.

mod obj;
mod step;

use crate::geometry::space::View;
use crate::geometry::surface::fit::FittedSurface;

/// A format that surfaces can be written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurfaceFormat {
    /// STEP AP214: the spline itself, one face over the whole rectangle that was fitted; beside the part it just goes on.
    Step,
    /// Wavefront OBJ: triangles with normals, only where the part was seen.
    Obj,
}

impl SurfaceFormat {
    /// File name endings of surfaces, for people.
    pub const ENDINGS: &str = ".step or .obj";

    /// The format that a file name's ending stands for, in capitals or not.
    ///
    /// ```
    /// use isomark::formats::surface::SurfaceFormat;
    /// assert_eq!(SurfaceFormat::from_name("fit.STP"), Some(SurfaceFormat::Step));
    /// assert_eq!(SurfaceFormat::from_name("fit.iges"), None);
    /// ```
    pub fn from_name(file_name: &str) -> Option<Self> {
        let (_, ending) = file_name.rsplit_once('.')?;
        match ending.to_ascii_lowercase().as_str() {
            "step" | "stp" => Some(Self::Step),
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }
}

/// The bytes of a surface file; the same surface gives the same bytes. `part` is the part's name and `view` the view the
/// surface was fitted in.
pub fn write(surface: &FittedSurface, view: &View, part: &str, format: SurfaceFormat) -> Vec<u8> {
    match format {
        SurfaceFormat::Step => step::write(&surface.calmed(), view, part),
        SurfaceFormat::Obj => obj::write(surface, view, part),
    }
}
