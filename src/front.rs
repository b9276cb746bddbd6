//! The front door for programs: a part, a drawing and settings in, a corrected drawing out.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::cache::Cache;
use crate::config::{ConfigError, JobSettings, Sku, Verify, ViewSource, parse_facing};
use crate::files::read_beside;
use crate::formats::mesh::PartFile;
use crate::geometry::space::ViewPoint;
use crate::pipeline::{self, LearnedPart, PatternInput, Pipeline, PipelineError};
use crate::preview;
use crate::reason::Reason;
use crate::report::Report;
use crate::report_html::{self, PageContent};

/// A part to be marked: a glTF, GLB, OBJ, STL or PLY file, or a scan, with the buffer files that it needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part(PartFile);

impl Part {
    /// Reads a part and its buffers from the same folder.
    ///
    /// # Errors
    /// When a file cannot be read, or the part names a buffer that is not a file in the same folder.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let (name, bytes) = named_content(path)?;
        let read = |buffer: &str| read_beside(path, buffer);
        let part = PartFile::with_buffers(name.clone(), bytes, read);
        Ok(Self(part.map_err(|error| error.reason().in_file(name))?))
    }

    /// A part in memory; the ending of its file name gives its format. A `.gltf` with buffers also needs
    /// [`with_buffer`](Self::with_buffer).
    pub fn from_bytes(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self(PartFile::alone(name, bytes))
    }

    /// The same part with a buffer that it names.
    #[must_use]
    pub fn with_buffer(mut self, name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        self.0.siblings.insert(name.into(), bytes.into());
        self
    }
}

/// A drawing: a DXF or SVG file, or a PNG or BMP picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drawing {
    name: String,
    bytes: Vec<u8>,
}

impl Drawing {
    /// Reads a drawing.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let (name, bytes) = named_content(path.as_ref())?;
        Ok(Self { name, bytes })
    }

    /// A drawing in memory, with its file name.
    pub fn from_bytes(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), bytes: bytes.into() }
    }
}

/// The settings for viewing a part and for placing and correcting a drawing; [`Default`] is `isomark correct` without
/// options.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settings(JobSettings);

impl Settings {
    /// The side of the part that faces the laser: `+z` (default), `-z`, `+x`, `-x`, `+y`, `-y`, or a direction `X,Y,Z`.
    ///
    /// # Errors
    /// When the text is not a valid side.
    pub fn facing(mut self, side: &str) -> Result<Self, Error> {
        self.0.part.facing = parse_facing(side).map_err(|error| {
            Reason::new("settings-choice", format!("The {error}."), "Use a side such as `-y`.")
        })?;
        self.0.part.view_source = ViewSource::Sides;
        Ok(self)
    }

    /// Places the middle of the drawing at this point of the view, mm; with a marking frame, at this point of the frame.
    #[must_use]
    pub fn place(mut self, x: f64, y: f64) -> Self {
        self.0.placement.place = Some(ViewPoint::new(x, y));
        self.0.placement.is_place_given = true;
        self
    }

    /// Rotates the drawing about its middle, degrees counter-clockwise.
    #[must_use]
    pub fn rotate(mut self, degrees: f64) -> Self {
        self.0.placement.rotate = degrees.to_radians();
        self
    }

    /// These settings, overridden by settings in TOML: the tables of a SKU's settings file, which are `[part]`, `[fixture]`,
    /// `[pattern]`, `[placement]`, `[correction]`, `[rotary]`, `[fill]`, `[focus]`, `[content]` and `[serial]`.
    ///
    /// ```
    /// # use isomark::{Error, Settings};
    /// let mut settings = Settings::default().with_toml("[placement]\nrotate_deg = 90\n")?;
    /// assert_eq!(settings.job().placement.rotate, 90f64.to_radians());
    /// # Ok::<(), Error>(())
    /// ```
    ///
    /// # Errors
    /// When the text contains an error; the reason gives its line.
    pub fn with_toml(&self, text: &str) -> Result<Self, Error> {
        Ok(Self(self.0.overridden_by(Path::new("settings"), text)?))
    }

    /// All settings, including those without a method here: the field, the lens, the output.
    pub fn job(&mut self) -> &mut JobSettings {
        &mut self.0
    }
}

impl From<JobSettings> for Settings {
    fn from(settings: JobSettings) -> Self {
        Self(settings)
    }
}

/// Fits parts.
#[derive(Debug, Clone)]
pub struct Corrector {
    pipeline: Pipeline,
}

impl Corrector {
    /// A corrector that keeps nothing on disk.
    #[must_use]
    pub fn new() -> Self {
        Self { pipeline: Pipeline::new(None) }
    }

    /// A corrector that keeps fitted surfaces in a folder, as a station does.
    pub fn keeping(folder: impl Into<PathBuf>) -> Self {
        Self { pipeline: Pipeline::new(Some(Cache::new(folder.into()))) }
    }

    /// Reads, samples and fits a part in the view that the settings give. The surface can then be used for many
    /// drawings.
    ///
    /// # Errors
    /// When the part cannot be read or has no surface to mark, or the folder of surfaces cannot be used.
    pub fn fit(&self, part: &Part, settings: &Settings) -> Result<Surface, Error> {
        let Part(part) = part;
        let stem = Path::new(&part.name).file_stem().unwrap_or_default().to_string_lossy();
        let sku: Sku = stem
            .parse()
            .or_else(|_| "part".parse())
            .map_err(|error: crate::config::BadSku| error.reason())?;
        let learned = self.pipeline.learn(&sku, part, &settings.0.part)?;
        Ok(Surface { pipeline: self.pipeline.clone(), sku, learned: Arc::new(learned) })
    }
}

impl Default for Corrector {
    fn default() -> Self {
        Self::new()
    }
}

/// A fitted part, ready for drawings.
#[derive(Debug, Clone)]
pub struct Surface {
    pipeline: Pipeline,
    sku: Sku,
    learned: Arc<LearnedPart>,
}

impl Surface {
    /// Corrects a drawing so that its lengths on the part are those drawn. A second reader checks the result, as in
    /// `isomark correct`. The part's settings are those that the surface was fitted with.
    ///
    /// # Errors
    /// When the drawing cannot be read, is not on the part, or cannot be marked there.
    pub fn correct(&self, drawing: &Drawing, settings: &Settings) -> Result<Correction, Error> {
        let input = PatternInput { name: &drawing.name, bytes: &drawing.bytes, previous: None };
        let mut corrected = self.pipeline.correct(&self.sku, &self.learned, input, &settings.0, true)?;
        if corrected.is_to_be_read_back(Verify::default()) {
            let dxf = std::mem::take(&mut corrected.dxf);
            let same = corrected.read_back(&dxf);
            corrected.dxf = dxf;
            same?;
        }
        Ok(Correction { corrected, pipeline: self.pipeline.clone(), learned: self.learned.clone() })
    }
}

/// A corrected drawing with its report.
#[derive(Debug)]
pub struct Correction {
    corrected: pipeline::Corrected,
    pipeline: Pipeline,
    learned: Arc<LearnedPart>,
}

impl Correction {
    /// The corrected drawing, a DXF file.
    #[must_use]
    pub fn dxf(&self) -> &[u8] {
        &self.corrected.dxf
    }

    /// The report: the accuracy of lengths, areas and angles, facts about the input, and notices.
    #[must_use]
    pub fn report(&self) -> &Report {
        &self.corrected.report
    }

    /// A picture of the part with the drawing before and after, as SVG.
    #[must_use]
    pub fn picture(&self) -> Vec<u8> {
        self.corrected.preview.as_ref().map(|picture| preview::svg(picture).into()).unwrap_or_default()
    }

    /// The report as a page for people: what `isomark correct --report-html` writes.
    #[must_use]
    pub fn report_html(&self) -> Vec<u8> {
        let pipeline::Corrected { report, preview, marked, landmarks, .. } = &self.corrected;
        let (Some(flat), Some(marked), Some(landmarks)) = (preview, marked, landmarks) else {
            return Vec::new();
        };
        let panels = preview::svg(flat);
        let on_part = self.pipeline.on_part(&self.learned, marked);
        let glb = preview::glb(&on_part);
        let content = PageContent { report, panels: &panels, on_part: &on_part, glb: &glb, landmarks };
        report_html::html(&content).into()
    }

    /// The part with the mark on it in three dimensions, as a binary glTF file: what `isomark correct --on-part` writes.
    #[must_use]
    pub fn on_part(&self) -> Vec<u8> {
        let picture =
            self.corrected.marked.as_ref().map(|marked| self.pipeline.on_part(&self.learned, marked));
        picture.map(|picture| preview::glb(&picture)).unwrap_or_default()
    }
}

/// Why a drawing was not corrected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The part, the drawing or the settings are rejected; trying again gives the same result.
    #[error("{0}")]
    Rejected(Reason),
    /// A file cannot be read, or the folder of surfaces cannot be used.
    #[error("{0}")]
    Environment(io::Error),
}

impl Error {
    /// The reason for people, with its code, its place and what to do.
    #[must_use]
    pub fn reason(&self) -> Reason {
        match self {
            Self::Rejected(reason) => reason.clone(),
            Self::Environment(error) => {
                let remedy = "Check that the file or folder exists and that this user may read or write it.";
                Reason::new("environment", format!("{error}."), remedy)
            }
        }
    }
}

impl From<Reason> for Error {
    fn from(reason: Reason) -> Self {
        Self::Rejected(reason)
    }
}

impl From<ConfigError> for Error {
    fn from(error: ConfigError) -> Self {
        Self::Rejected(error.reason())
    }
}

impl From<PipelineError> for Error {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Rejected(reason) => Self::Rejected(reason),
            PipelineError::Environment(error) => Self::Environment(error),
            // This does not occur: the pipeline runs without a limit here.
            error @ PipelineError::TakesLong => {
                Self::Rejected(Reason::new("takes-long", format!("{error}."), "Try again."))
            }
        }
    }
}

/// A file's name and content.
fn named_content(path: &Path) -> Result<(String, Vec<u8>), Error> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok((name, fs_err::read(path).map_err(Error::Environment)?))
}

/// Everything here can be sent to other threads and shared between them; the build fails otherwise.
const _: () = {
    const fn is_send_and_sync<T: Send + Sync>() {}
    is_send_and_sync::<Part>();
    is_send_and_sync::<Drawing>();
    is_send_and_sync::<Settings>();
    is_send_and_sync::<Corrector>();
    is_send_and_sync::<Surface>();
    is_send_and_sync::<Correction>();
    is_send_and_sync::<Error>();
    is_send_and_sync::<Report>();
    is_send_and_sync::<Reason>();
};
