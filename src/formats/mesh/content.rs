//! The formats under which a file that is called a part may be found.

use std::fmt;

use super::{MeshFormat, is_unread_part};

/// A format of files, recognised by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Content {
    /// Polygon file format.
    Ply,
    /// 3D Manufacturing Format.
    ThreeMf,
    /// STEP (ISO 10303-21).
    Step,
    /// STL, text or binary.
    Stl,
    /// Wavefront OBJ.
    Obj,
    /// Additive Manufacturing Format.
    Amf,
    /// A project of FreeCAD.
    FreeCad,
    /// Another ZIP archive.
    Zip,
    /// Data compressed by gzip.
    Gzip,
    /// A 7-Zip or RAR archive.
    Archive,
    /// Portable Document Format.
    Pdf,
    /// A web page.
    Html,
    /// SVG, a drawing.
    Svg,
    /// DXF, a drawing.
    Dxf,
    /// A picture: PNG or JPEG.
    Picture,
    /// A project of Blender.
    Blend,
    /// An Autodesk FBX scene.
    Fbx,
    /// COLLADA.
    Collada,
    /// A document in Microsoft's compound format, such as a SolidWorks part.
    Compound,
}

impl Content {
    /// The name's ending of files in this format, where isomark may read them as a part.
    fn ending(self) -> Option<&'static str> {
        Some(match self {
            Self::Ply => ".ply",
            Self::ThreeMf => ".3mf",
            Self::Step => ".step",
            Self::Stl => ".stl",
            Self::Obj => ".obj",
            _ => return None,
        })
    }

    /// Whether it is the content of parts in this format.
    pub(super) fn is(self, format: MeshFormat) -> bool {
        self.ending().and_then(|ending| MeshFormat::from_name(&format!("part{ending}"))) == Some(format)
    }

    /// What to do with such a file.
    pub(super) fn remedy(self) -> String {
        if let Some(ending) = self.ending().filter(|ending| !is_unread_part(&format!("part{ending}"))) {
            return format!("rename the file so that its name ends in {ending}");
        }
        let export = "export the part as STEP, GLB, glTF with its .bin, OBJ, STL, PLY or 3MF";
        match self {
            Self::Zip | Self::Gzip | Self::Archive => {
                format!("unpack the file; if that is not a part, {export}")
            }
            Self::Svg | Self::Dxf | Self::Picture => {
                format!("use it as the drawing, with the extension that its program gave it; {export}")
            }
            Self::Html => format!("download the file again: this is the page of a web site; or {export}"),
            _ => export.into(),
        }
    }
}

impl fmt::Display for Content {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Ply => "a PLY file",
            Self::ThreeMf => "a 3MF file",
            Self::Step => "a STEP file",
            Self::Stl => "an STL file",
            Self::Obj => "an OBJ file",
            Self::Amf => "an AMF file",
            Self::FreeCad => "a project of FreeCAD",
            Self::Zip => "a ZIP archive",
            Self::Gzip => "a file compressed by gzip",
            Self::Archive => "a compressed archive",
            Self::Pdf => "a PDF document",
            Self::Html => "a web page",
            Self::Svg => "an SVG drawing",
            Self::Dxf => "a DXF drawing",
            Self::Picture => "a picture",
            Self::Blend => "a project of Blender",
            Self::Fbx => "an FBX scene",
            Self::Collada => "a COLLADA scene",
            Self::Compound => "a document of a CAD or office program",
        })
    }
}
