//! What `correct` and `evaluate` have in common: the part, the drawing, and its place on the part.

use std::path::{Path, PathBuf};

use clap::Args;

use super::content::ContentArguments;
use super::named_files::{cache_of, known_cache, name_of, read_file, read_part, share_is_there};
use super::options::{MeaningArguments, ScanArguments, parse_sku};
use super::outcome::Failure;
use super::progress::ProgressLine;
use super::set::{
    SetArguments, add_list, add_options, refuse_options_of_other_formats, refuse_options_of_what_is_off,
};
use crate::config::{JobSettings, LiveSettings, Overrides, PartShape, Sku, Verify};
use crate::formats::mesh::MeshFormat;
use crate::hotfolder::UsedFolder;
use crate::pipeline::{LearnedPart, Pipeline};
use crate::reason::Reason;

const INPUT: &str = "Part and drawing";
const PLACEMENT: &str = "Placement";
const COMPARISON: &str = "Methods to compare with";

#[derive(Debug, Args)]
pub(super) struct JobArguments {
    /// The part (.step, .glb, .gltf, .obj, .stl, .ply, .3mf), or a scan of it (.ply, .xyz, .csv, .txt), and the drawing (.dxf, .svg, .png, .bmp); the part may be left out for a SKU whose surface is kept.
    #[arg(required = true, num_args = 1..=2, value_names = ["PART", "DRAWING"])]
    inputs: Vec<PathBuf>,
    /// The product that the part belongs to; its surface is kept for later drawings. Default: the part's file name.
    #[arg(long, help_heading = INPUT)]
    sku: Option<String>,
    /// A station's file: its settings, its SKUs' settings and its cache are used, except where an option is given.
    #[arg(long, value_name = "FILE", help_heading = INPUT)]
    station: Option<PathBuf>,
    /// Where fitted surfaces are kept; default: the station's cache, or the user's.
    #[arg(long, value_name = "DIR", help_heading = INPUT)]
    cache: Option<PathBuf>,
    /// Instead of a part: a cylinder of this diameter and length, mm. The view's origin is the middle of its crest.
    #[arg(long, value_name = "D,LENGTH", help_heading = INPUT, allow_hyphen_values = true, conflicts_with = "cone")]
    cylinder: Option<String>,
    /// Instead of a part: a cone of these diameters at its ends and this length along its axis, mm.
    #[arg(long, value_name = "D,END,LENGTH", help_heading = INPUT, allow_hyphen_values = true)]
    cone: Option<String>,
    /// Direction of the cylinder's or cone's axis as the laser sees it, from the first end: y (default), -y, x, -x or X,Y,Z.
    #[arg(long, value_name = "AXIS", help_heading = INPUT, allow_hyphen_values = true)]
    axis: Option<String>,
    /// The side of the part that faces the laser: +z (default), -z, +x, -x, +y, -y or a direction X,Y,Z.
    #[arg(long, value_name = "SIDE", help_heading = PLACEMENT, allow_hyphen_values = true, conflicts_with_all = ["cylinder", "cone"])]
    facing: Option<String>,
    /// Turns the view about the laser's axis, degrees counter-clockwise, -360 to 360.
    #[arg(long, value_name = "DEG", help_heading = PLACEMENT, allow_hyphen_values = true, conflicts_with_all = ["cylinder", "cone"])]
    roll: Option<String>,
    /// The marking frame in the part frame: "OX,OY,OZ ZX,ZY,ZZ XX,XY,XZ", where the anchor is placed, mm, the direction to
    /// the laser, and the direction of the drawing's x. Default: the node `isomark` of a glTF part.
    #[arg(long, value_name = "FRAME", help_heading = PLACEMENT, allow_hyphen_values = true, conflicts_with_all = ["cylinder", "cone", "facing", "roll"])]
    frame: Option<String>,
    /// Where the anchor is placed in the view, mm; with a marking frame, from its origin. Default: where it was drawn; with a
    /// marking frame, its origin.
    #[arg(long, value_name = "X,Y", help_heading = PLACEMENT, allow_hyphen_values = true)]
    place: Option<String>,
    /// The point of the drawing that is placed and turned about: center (of its extents, default), origin, or X,Y in mm.
    #[arg(long, value_name = "POINT", help_heading = PLACEMENT, allow_hyphen_values = true)]
    anchor: Option<String>,
    /// Turns the drawing about its anchor, degrees counter-clockwise, -360 to 360.
    #[arg(long, value_name = "DEG", help_heading = PLACEMENT, allow_hyphen_values = true)]
    rotate: Option<String>,
    /// The drawing's x at its anchor: view (horizontal as the laser sees it, default) or axis (along the direction round the
    /// axis of a cylinder or cone).
    #[arg(long, value_name = "WHAT", help_heading = PLACEMENT)]
    align: Option<String>,
    #[command(flatten)]
    meaning: MeaningArguments,
    #[command(flatten)]
    scan: ScanArguments,
    /// The layers that are marked; others are carried along unmarked. Default: all.
    #[arg(long, value_name = "A,B", help_heading = INPUT, value_delimiter = ',')]
    ink_layers: Option<Vec<String>>,
    /// Cells along each side of the mapping domain, 2 to 200; default 30.
    #[arg(long, value_name = "CELLS", help_heading = COMPARISON, allow_hyphen_values = true)]
    mapping_domain_grid: Option<String>,
    /// Intervals of Simpson's rule along each of its cells, even, 2 to 1000; default 50.
    #[arg(long, value_name = "INTERVALS", help_heading = COMPARISON, allow_hyphen_values = true)]
    mapping_domain_intervals: Option<String>,
    /// Errors in the printed algorithms to keep: simpson-weights, diagonal-sums, knot-vectors. Default: all are corrected.
    #[arg(long, value_name = "A,B", help_heading = COMPARISON, value_delimiter = ',')]
    mapping_domain_as_printed: Option<Vec<String>>,
    /// How floater weights a vertex's neighbours: uniform (as in the thesis, default) or mean-value.
    #[arg(long, value_name = "WHICH", help_heading = COMPARISON)]
    floater_weights: Option<String>,
    #[command(flatten)]
    pub(super) content: ContentArguments,
    #[command(flatten)]
    pub(super) set: SetArguments,
}

/// A part that is ready, and the drawing for it.
pub(super) struct Job<'a> {
    pub(super) sku: Sku,
    pub(super) settings: JobSettings,
    pub(super) pipeline: Pipeline,
    pub(super) learned: LearnedPart,
    pub(super) pattern: &'a Path,
    pub(super) drawing: Vec<u8>,
    /// The files beside the part that were read with it.
    pub(super) beside_part: Vec<PathBuf>,
    /// Which written drawings are read back.
    pub(super) verify: Verify,
    /// Shows the current step as long as it lives.
    pub(super) progress: ProgressLine,
}

impl JobArguments {
    /// All files that are read.
    pub(super) fn files(&self) -> Vec<&Path> {
        self.inputs.iter().chain(&self.station).map(PathBuf::as_path).collect()
    }

    /// Reads the settings, then the part and the drawing. `overrides` holds the settings of options that only one command
    /// has; `useless` gives the reason why a setting has no effect in the command.
    pub(super) fn prepare(
        &self,
        mut overrides: Overrides,
        useless: impl Fn(&str) -> Option<&'static str>,
    ) -> Result<Job<'_>, Failure> {
        self.add_to(&mut overrides)?;
        self.set.add_to(&mut overrides, useless)?;
        let (part, pattern) = inputs(&self.inputs)?;
        let sku = self.sku(part, overrides.text("part.shape"))?;
        // The station's tables are part of its file; those of the job override the SKU's file, too.
        let (of_job, of_station) = overrides.split();
        let live = self.station.as_deref().map(|file| LiveSettings::open_with(file, of_station.clone()));
        let mut live = live.transpose()?.map(LiveSettings::at_once);
        let (settings, verify) = match &mut live {
            Some(live) => {
                share_is_there(live.station(), UsedFolder::Skus)?;
                if self.cache.is_none() {
                    share_is_there(live.station(), UsedFolder::Cache)?;
                }
                // A station that was never started has no folder for its SKUs yet.
                let settings = match live.station().folders.skus.exists() {
                    true => live.job(&sku)?,
                    false => live.station().settings.clone(),
                };
                (settings, live.station().delivery.verify)
            }
            None => JobSettings::without_station(&of_station)?,
        };
        let mut settings = settings.with_overrides(&of_job)?;
        // The name of a shape names the job, but no product.
        if self.sku.is_none() && part.is_none() {
            settings.content.values.sku = Some(String::new());
        }
        self.content.add_to(&mut settings)?;
        let drawing = read_file(pattern)?;
        refuse_options_of_other_formats(&of_job, &name_of(pattern)?, &drawing)?;
        refuse_options_of_what_is_off(&of_job, &settings)?;
        let station = live.as_ref().map(LiveSettings::station);
        // Only a part that is not given must have been kept.
        let cache = match part.is_some() || settings.part.primitive.is_some() {
            true => known_cache(self.cache.as_deref(), station),
            false => Some(cache_of(self.cache.as_deref(), station)?),
        };
        let progress = ProgressLine::start();
        let pipeline = Pipeline::new(cache).observed(progress.observer());
        let (learned, beside_part) = match part {
            Some(path) => {
                let part = read_part(path)?;
                let beside = part.siblings.keys().map(|name| path.with_file_name(name)).collect();
                (pipeline.learn(&sku, &part, &settings.part)?, beside)
            }
            None => (recall(&pipeline, &sku, &settings)?, Vec::new()),
        };
        Ok(Job { sku, settings, pipeline, learned, pattern, drawing, beside_part, verify, progress })
    }

    fn sku(&self, part: Option<&Path>, shape: Option<String>) -> Result<Sku, Failure> {
        match (&self.sku, part.and_then(Path::file_stem), shape) {
            (Some(sku), ..) => parse_sku(sku),
            (None, Some(stem), _) => parse_sku(&stem.to_string_lossy()),
            (None, None, Some(shape)) if shape != PartShape::Mesh.name() => parse_sku(&shape),
            _ => Err(Failure::usage(
                "The command line names neither a part nor a SKU.",
                "Name the part, its SKU with `--sku`, or its sizes with `--cylinder` or `--cone`.",
            )),
        }
    }

    fn add_to(&self, overrides: &mut Overrides) -> Result<(), Failure> {
        self.add_shape(overrides)?;
        add_options(
            overrides,
            &[
                ("--axis", "part.axis", self.axis.as_ref()),
                ("--facing", "part.facing", self.facing.as_ref()),
                ("--roll", "part.roll_deg", self.roll.as_ref()),
                ("--frame", "part.frame", self.frame.as_ref()),
                ("--place", "placement.place_mm", self.place.as_ref()),
                ("--anchor", "placement.anchor", self.anchor.as_ref()),
                ("--rotate", "placement.rotate_deg", self.rotate.as_ref()),
                ("--align", "placement.align", self.align.as_ref()),
                (
                    "--mapping-domain-grid",
                    "correction.mapping_domain_grid",
                    self.mapping_domain_grid.as_ref(),
                ),
                (
                    "--mapping-domain-intervals",
                    "correction.mapping_domain_intervals",
                    self.mapping_domain_intervals.as_ref(),
                ),
                ("--floater-weights", "correction.floater_weights", self.floater_weights.as_ref()),
            ],
        )?;
        self.meaning.add_to(overrides)?;
        self.scan.add_to(overrides)?;
        add_list(overrides, "--ink-layers", "pattern.ink_layers", self.ink_layers.as_ref())?;
        let slips = self.mapping_domain_as_printed.as_ref();
        add_list(overrides, "--mapping-domain-as-printed", "correction.mapping_domain_as_printed", slips)
    }

    /// Adds the sizes of a cylinder or cone, each as the setting it is.
    fn add_shape(&self, overrides: &mut Overrides) -> Result<(), Failure> {
        let (option, shape, keys, example, typed): (_, _, &[&str], _, _) = match (&self.cylinder, &self.cone)
        {
            (Some(typed), _) => {
                let keys = &["part.diameter_mm", "part.length_mm"];
                ("--cylinder", PartShape::Cylinder, keys, "diameter and length in mm, as in 73,180", typed)
            }
            (None, Some(typed)) => {
                let keys = &["part.diameter_mm", "part.end_diameter_mm", "part.length_mm"];
                let example = "both diameters and the length in mm, as in 60,85,120";
                ("--cone", PartShape::Cone, keys, example, typed)
            }
            (None, None) => return Ok(()),
        };
        let option = format!("{option} {typed}");
        let sizes: Vec<&str> = typed.split(',').collect();
        if sizes.len() != keys.len() {
            return Err(Failure::usage(
                format!("`{option}` does not give the sizes of a {shape}."),
                format!("Give {example}."),
            ));
        }
        overrides.add(&option, "part.shape", shape.name())?;
        for (key, size) in keys.iter().zip(sizes) {
            overrides.add(&option, key, size)?;
        }
        Ok(())
    }
}

fn inputs(named: &[PathBuf]) -> Result<(Option<&Path>, &Path), Failure> {
    let is_part = |path: &PathBuf| MeshFormat::from_name(&path.to_string_lossy()).is_some();
    match named {
        [part, pattern] if is_part(pattern) && !is_part(part) => Ok((Some(pattern), part)),
        [part, pattern] => Ok((Some(part), pattern)),
        [pattern] if !is_part(pattern) => Ok((None, pattern)),
        _ => Err(Failure::usage(
            "The command line names a part but no drawing.",
            "Name the drawing after the part.",
        )),
    }
}

fn recall(pipeline: &Pipeline, sku: &Sku, settings: &JobSettings) -> Result<LearnedPart, Failure> {
    let mut noticed = Vec::new();
    let kept = pipeline.recall(sku, &settings.part, &mut noticed)?;
    kept.ok_or_else(|| match noticed.first() {
        Some(damage) => Failure::rejected(Reason::new(
            "cache-damaged",
            damage.message.clone(),
            "Name the part before the drawing; isomark then fits and keeps its surface again.",
        )),
        None => unknown_sku(sku),
    })
}

fn unknown_sku(sku: &Sku) -> Failure {
    Failure::rejected(Reason::new(
        "sku-unknown",
        format!("No surface is kept for the SKU {sku} under these settings."),
        "Name the part before the drawing; isomark then keeps its surface.",
    ))
}
