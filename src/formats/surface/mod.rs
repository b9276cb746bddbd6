//! Writes fitted surfaces as files for CAD, in the part frame and in mm, so that surface and part coincide.

mod obj;
mod step;

use crate::geometry::space::View;
use crate::geometry::surface::fit::FittedSurface;

/// A file format for fitted surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SurfaceFormat {
    /// STEP AP214: the B-spline surface as one face over the whole fitted rectangle, so it continues beyond the part.
    Step,
    /// Wavefront OBJ: triangles with normals, only where the part is visible in the view.
    Obj,
}

impl SurfaceFormat {
    /// File name endings of surfaces, for people.
    pub const ENDINGS: &str = ".step or .obj";

    /// The format for a file name's ending, in upper or lower case.
    ///
    /// ```
    /// use isomark::formats::surface::SurfaceFormat;
    /// assert_eq!(SurfaceFormat::from_name("fit.STP"), Some(SurfaceFormat::Step));
    /// assert_eq!(SurfaceFormat::from_name("fit.iges"), None);
    /// ```
    #[must_use]
    pub fn from_name(file_name: &str) -> Option<Self> {
        let (_, ending) = file_name.rsplit_once('.')?;
        match ending.to_ascii_lowercase().as_str() {
            "step" | "stp" => Some(Self::Step),
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }
}

/// The bytes of a surface file; the same surface gives the same bytes. `part` is the part's name and `view` the view
/// the surface was fitted in.
#[must_use]
pub fn write(surface: &FittedSurface, view: &View, part: &str, format: SurfaceFormat) -> Vec<u8> {
    match format {
        SurfaceFormat::Step => step::write(&surface.calmed(), view, part),
        SurfaceFormat::Obj => obj::write(surface, view, part),
    }
}
