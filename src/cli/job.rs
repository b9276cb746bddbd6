//! What `correct` and `evaluate` have in common: part, drawing, and where one lands on the other.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use nalgebra::Vector3;

use super::named_files::{cache_of, read_file, read_part};
use super::options::{MeaningArguments, ScanArguments, parse_sku};
use super::outcome::{Failure, Outcome};
use crate::config::{
    Anchor, FloaterWeights, JobSettings, LiveSettings, Sku, Slip, Verify, parse_axis, parse_facing,
};
use crate::formats::mesh::MeshFormat;
use crate::geometry::mapping::mapping_domain::MappingDomainOptions;
use crate::geometry::primitive::Primitive;
use crate::geometry::space::{Facing, FlatPoint, ViewPoint};
use crate::pipeline::{LearnedPart, Pipeline};
use crate::reason::Reason;

const INPUT: &str = "Part and drawing";
const PLACEMENT: &str = "Placement";
const COMPARISON: &str = "Methods to compare with";

#[derive(Debug, Args)]
pub(super) struct JobArguments {
    /// The part (.glb, .gltf, .obj, .stl, .ply), or a scan of it (.ply, .xyz, .csv, .txt), and the drawing (.dxf, .png, .bmp); the part may be left out for a SKU whose surface is kept.
    #[arg(required = true, num_args = 1..=2, value_names = ["PART", "PATTERN"])]
    inputs: Vec<PathBuf>,
    /// The product that the part belongs to; its surface is kept for later drawings. Default: the part's file name.
    #[arg(long, help_heading = INPUT)]
    sku: Option<String>,
    /// A station's file: its settings, its SKUs' settings and its cache hold, where no option says otherwise.
    #[arg(long, value_name = "FILE", help_heading = INPUT)]
    station: Option<PathBuf>,
    /// Where fitted surfaces are kept; default: the station's cache, or the user's.
    #[arg(long, value_name = "DIR", help_heading = INPUT)]
    cache: Option<PathBuf>,
    /// Instead of a part: a cylinder of this diameter and length, mm. The view's origin is the middle of its crest.
    #[arg(long, value_name = "D,LENGTH", help_heading = INPUT, value_parser = parse_numbers::<2>, conflicts_with = "cone")]
    cylinder: Option<[f64; 2]>,
    /// Instead of a part: a cone of these diameters at its ends, and this length along its axis, mm.
    #[arg(long, value_name = "D,END,LENGTH", help_heading = INPUT, value_parser = parse_numbers::<3>)]
    cone: Option<[f64; 3]>,
    /// How the cylinder or cone lies before the laser, from its first end on: y (default), -y, x, -x or a direction X,Y,Z.
    #[arg(long, value_name = "AXIS", help_heading = INPUT, allow_hyphen_values = true, value_parser = parse_axis)]
    axis: Option<Vector3<f64>>,
    /// The side of the part that faces the laser: +z (default), -z, +x, -x, +y, -y or a direction X,Y,Z.
    #[arg(long, value_name = "SIDE", help_heading = PLACEMENT, allow_hyphen_values = true, value_parser = parse_facing, conflicts_with_all = ["cylinder", "cone"])]
    facing: Option<Facing>,
    /// Turns the view about the laser's axis, degrees counter-clockwise.
    #[arg(long, value_name = "DEG", help_heading = PLACEMENT, allow_hyphen_values = true, conflicts_with_all = ["cylinder", "cone"])]
    roll: Option<f64>,
    /// Where the anchor lands in the view, mm; default: where it was drawn.
    #[arg(long, value_name = "X,Y", help_heading = PLACEMENT, allow_hyphen_values = true, value_parser = parse_numbers::<2>)]
    place: Option<[f64; 2]>,
    /// The point of the drawing that is placed and turned about: center (of its extents, default), origin, or X,Y in mm.
    #[arg(long, value_name = "POINT", help_heading = PLACEMENT, allow_hyphen_values = true, value_parser = parse_anchor)]
    anchor: Option<Anchor>,
    /// Turns the drawing about its anchor, degrees counter-clockwise.
    #[arg(long, value_name = "DEG", help_heading = PLACEMENT, allow_hyphen_values = true)]
    rotate: Option<f64>,
    #[command(flatten)]
    meaning: MeaningArguments,
    #[command(flatten)]
    scan: ScanArguments,
    /// The layers that are marked; others are carried along without counting as ink. Default: all.
    #[arg(long, value_name = "A,B", help_heading = INPUT, value_delimiter = ',')]
    ink_layers: Option<Vec<String>>,
    /// Cells along each side of the mapping domain; default 30.
    #[arg(long, value_name = "CELLS", help_heading = COMPARISON)]
    mapping_domain_grid: Option<usize>,
    /// Intervals of Simpson's rule along each of its cells, even; default 50.
    #[arg(long, value_name = "INTERVALS", help_heading = COMPARISON)]
    mapping_domain_intervals: Option<usize>,
    /// Slips of the printed algorithms that stay: simpson-weights, diagonal-sums, knot-vectors; default: all are corrected.
    #[arg(long, value_name = "A,B", help_heading = COMPARISON, value_delimiter = ',')]
    mapping_domain_as_printed: Option<Vec<Slip>>,
    /// What floater makes of a vertex's neighbours: uniform (as in the thesis, default) or mean-value.
    #[arg(long, value_name = "WHICH", help_heading = COMPARISON)]
    floater_weights: Option<FloaterWeights>,
}

/// A part that is ready, and the drawing for it.
pub(super) struct Job<'a> {
    pub(super) sku: Sku,
    pub(super) settings: JobSettings,
    pub(super) pipeline: Pipeline,
    pub(super) learned: LearnedPart,
    pub(super) pattern: &'a Path,
    pub(super) drawing: Vec<u8>,
    /// Which written drawings are read back.
    pub(super) verify: Verify,
}

impl JobArguments {
    /// All files that are read.
    pub(super) fn files(&self) -> Vec<&Path> {
        self.inputs.iter().chain(&self.station).map(PathBuf::as_path).collect()
    }

    /// Reads the settings, which `adjust` may change, then the part and the drawing.
    pub(super) fn prepare(
        &self,
        adjust: impl FnOnce(&mut JobSettings) -> Outcome,
    ) -> Result<Job<'_>, Failure> {
        let (part, pattern) = inputs(&self.inputs)?;
        let sku = self.sku(part)?;
        let live = self.station.as_deref().map(LiveSettings::open).transpose()?;
        let mut live = live.map(LiveSettings::at_once);
        let mut settings = match &mut live {
            // A station that was never started has no folder for its SKUs yet.
            Some(live) if !live.station().folders.skus.exists() => live.station().settings.clone(),
            Some(live) => live.job(&sku)?,
            None => JobSettings::default(),
        };
        self.apply(&mut settings)?;
        adjust(&mut settings)?;
        let cache = cache_of(self.cache.as_deref(), live.as_ref().map(LiveSettings::station))?;
        let verify = live.as_ref().map(|live| live.station().delivery.verify).unwrap_or_default();
        let pipeline = Pipeline::new(Some(cache));
        let drawing = read_file(pattern)?;
        let learned = match part {
            Some(part) => pipeline.learn(&sku, &read_part(part)?, &settings.part)?,
            None => recall(&pipeline, &sku, &settings)?,
        };
        Ok(Job { sku, settings, pipeline, learned, pattern, drawing, verify })
    }

    fn sku(&self, part: Option<&Path>) -> Result<Sku, Failure> {
        match (&self.sku, part.and_then(Path::file_stem)) {
            (Some(sku), _) => parse_sku(sku),
            (None, Some(stem)) => parse_sku(&stem.to_string_lossy()),
            (None, None) if self.cylinder.is_some() => parse_sku("cylinder"),
            (None, None) if self.cone.is_some() => parse_sku("cone"),
            (None, None) => Err(Failure::usage(
                "There is neither a part nor a SKU.",
                "Name the part, its SKU with `--sku`, or its sizes with `--cylinder` or `--cone`.",
            )),
        }
    }

    fn primitive(&self) -> Result<Option<Primitive>, Failure> {
        let sizes = self.cylinder.map(|[diameter, length]| [diameter, diameter, length]).or(self.cone);
        let Some([diameter, end, length]) = sizes else {
            return match self.axis {
                None => Ok(None),
                Some(_) => Err(Failure::usage(
                    "`--axis` says how a cylinder or cone lies, and there is none.",
                    "Give `--cylinder` or `--cone` too; a mesh is turned with `--facing` and `--roll`.",
                )),
            };
        };
        let primitive = Primitive::new(diameter, end, length, self.axis.unwrap_or(Vector3::y()));
        primitive.map(Some).ok_or_else(|| {
            Failure::usage(
                "These are no sizes of a cylinder or cone.",
                "Give diameters and length in mm, all greater than 0, as in `--cylinder 73,180`.",
            )
        })
    }

    fn apply(&self, settings: &mut JobSettings) -> Outcome {
        set(&mut settings.part.facing, self.facing.as_ref());
        set(&mut settings.part.roll, self.roll.map(f64::to_radians).as_ref());
        settings.part.unit = self.meaning.part_unit.or(settings.part.unit);
        settings.part.up = self.meaning.part_up.or(settings.part.up);
        let primitive = self.primitive()?;
        let smoothing = self.scan.smoothing()?;
        let is_given = [
            ("--part-unit", self.meaning.part_unit.is_some()),
            ("--part-up", self.meaning.part_up.is_some()),
            ("--smoothing", smoothing.is_some()),
        ];
        if let (Some(_), Some((option, _))) = (primitive, is_given.iter().find(|(_, is_given)| *is_given)) {
            return Err(Failure::usage(
                format!("`{option}` says how a part file is read, and a cylinder or cone has none."),
                "Leave it out; `--cylinder` and `--cone` take mm.",
            ));
        }
        settings.part.primitive = primitive.or(settings.part.primitive);
        settings.part.smoothing = smoothing.unwrap_or(settings.part.smoothing);
        self.meaning.apply(&mut settings.pattern);
        if self.ink_layers.is_some() {
            settings.pattern.ink_layers.clone_from(&self.ink_layers);
        }
        settings.placement.place = self.place.map(|[x, y]| ViewPoint::new(x, y)).or(settings.placement.place);
        set(&mut settings.placement.anchor, self.anchor.as_ref());
        set(&mut settings.placement.rotate, self.rotate.map(f64::to_radians).as_ref());
        let angles = [settings.part.roll, settings.placement.rotate];
        if angles.iter().any(|angle| !angle.is_finite()) {
            return Err(Failure::usage(
                "An angle is not a number.",
                "Give `--rotate` and `--roll` in degrees.",
            ));
        }
        set(&mut settings.correction.floater_weights, self.floater_weights.as_ref());
        let domain = &mut settings.correction.mapping_domain;
        set(&mut domain.grid, self.mapping_domain_grid.as_ref());
        set(&mut domain.intervals, self.mapping_domain_intervals.as_ref());
        if let Some(slips) = &self.mapping_domain_as_printed {
            domain.as_printed = slips.iter().copied().collect();
        }
        if !MappingDomainOptions::GRIDS.contains(&domain.grid)
            || !MappingDomainOptions::INTERVALS.contains(&domain.intervals)
            || domain.intervals % 2 == 1
        {
            return Err(Failure::usage(
                format!(
                    "A mapping domain of {} cells with {} intervals makes no sense.",
                    domain.grid, domain.intervals
                ),
                "Give `--mapping-domain-grid` from 2 to 200 and an even `--mapping-domain-intervals` from 2 to 1000.",
            ));
        }
        Ok(())
    }
}

/// Takes over what was given on the command line.
pub(super) fn set<T: Clone>(to: &mut T, given: Option<&T>) {
    if let Some(given) = given {
        to.clone_from(given);
    }
}

fn inputs(named: &[PathBuf]) -> Result<(Option<&Path>, &Path), Failure> {
    let is_part = |path: &PathBuf| MeshFormat::from_name(&path.to_string_lossy()).is_some();
    match named {
        [part, pattern] if is_part(pattern) && !is_part(part) => Ok((Some(pattern), part)),
        [part, pattern] => Ok((Some(part), pattern)),
        [pattern] if !is_part(pattern) => Ok((None, pattern)),
        _ => Err(Failure::usage("There is a part but no drawing.", "Name the drawing after the part.")),
    }
}

fn recall(pipeline: &Pipeline, sku: &Sku, settings: &JobSettings) -> Result<LearnedPart, Failure> {
    let mut noticed = Vec::new();
    let kept = pipeline.recall(sku, &settings.part, &mut noticed)?;
    kept.ok_or_else(|| match noticed.first() {
        Some(damage) => Failure::rejected(Reason::new(
            "cache-damaged",
            damage.message.clone(),
            "Name the part before the drawing; its surface is then fitted and kept again.",
        )),
        None => unknown_sku(sku),
    })
}

fn unknown_sku(sku: &Sku) -> Failure {
    Failure::rejected(Reason::new(
        "sku-unknown",
        format!("No surface is kept for the SKU {sku} under these settings."),
        "Name the part before the drawing; its surface is kept from then on.",
    ))
}

fn parse_numbers<const COUNT: usize>(text: &str) -> Result<[f64; COUNT], String> {
    let numbers: Vec<f64> = text.split(',').map_while(|part| f64::from_str(part.trim()).ok()).collect();
    let whole = text.matches(',').count() + 1 == COUNT && numbers.iter().all(|number| number.is_finite());
    let count = if COUNT == 2 { "two" } else { "three" };
    let example = ["12.5", "-3", "40"][..COUNT].join(",");
    numbers.try_into().ok().filter(|_| whole).ok_or(format!("give {count} numbers in mm, as in {example}"))
}

fn parse_anchor(text: &str) -> Result<Anchor, String> {
    match text {
        "center" => Ok(Anchor::Center),
        "origin" => Ok(Anchor::Origin),
        _ => parse_numbers::<2>(text)
            .map(|[x, y]| Anchor::At(FlatPoint::new(x, y)))
            .map_err(|_| "give center, origin, or a point of the drawing in mm, as in 12.5,-3".into()),
    }
}
