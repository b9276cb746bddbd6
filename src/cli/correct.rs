//! `isomark correct`: one drawing for one part.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;

use super::{
    Failure, MeaningArguments, Outcome, ScanArguments, cache_of, file_trouble, name_of, parse_sku, print,
    read_file, sibling_of, tell, write_file,
};
use crate::config::{Anchor, JobSettings, LiveSettings, Method, Sku, Vertices, Weighting, parse_facing};
use crate::files::read_if_there;
use crate::formats::mesh::MeshFormat;
use crate::geometry::space::{Facing, FlatPoint, ViewPoint};
use crate::pipeline::{LearnedPart, PartInput, PatternInput, Pipeline};
use crate::reason::Reason;

const INPUT: &str = "Part and drawing";
const PLACEMENT: &str = "Placement";
const CORRECTION: &str = "Correction";

#[derive(Debug, Args)]
#[command(
    override_usage = "isomark correct [OPTIONS] --out <OUT.dxf> <PART> <PATTERN>\n       isomark correct [OPTIONS] --out <OUT.dxf> --sku <SKU> <PATTERN>"
)]
pub(super) struct CorrectArguments {
    /// The part (.glb, .gltf, .obj, .stl, .ply), or a scan of it (.ply, .xyz, .csv, .txt), and the drawing (.dxf, .png, .bmp); the part may be left out for a SKU whose surface is kept.
    #[arg(required = true, num_args = 1..=2, value_names = ["PART", "PATTERN"])]
    inputs: Vec<PathBuf>,
    /// The corrected drawing to write.
    #[arg(long, short, value_name = "OUT.dxf")]
    out: PathBuf,
    /// The product that the part belongs to; its surface is kept for later drawings. Default: the part's file name.
    #[arg(long, help_heading = INPUT)]
    sku: Option<String>,
    /// A station's file: its settings, its SKUs' settings and its cache hold, where no option says otherwise.
    #[arg(long, value_name = "FILE", help_heading = INPUT)]
    station: Option<PathBuf>,
    /// Where fitted surfaces are kept; default: the station's cache, or the user's.
    #[arg(long, value_name = "DIR", help_heading = INPUT)]
    cache: Option<PathBuf>,
    /// How the drawing is bent: auto (exact on cylinders and cones, otherwise isometric), isometric, cylinder, cone, none.
    #[arg(long, help_heading = CORRECTION)]
    method: Option<Method>,
    /// Where `isometric` keeps lengths first: on the ink (default), or uniform over the drawing's rectangle.
    #[arg(long, help_heading = CORRECTION)]
    weighting: Option<Weighting>,
    /// The side of the part that faces the laser: +z (default), -z, +x, -x, +y, -y or a direction X,Y,Z.
    #[arg(long, value_name = "SIDE", help_heading = PLACEMENT, allow_hyphen_values = true, value_parser = parse_facing)]
    facing: Option<Facing>,
    /// Turns the view about the laser's axis, degrees counter-clockwise.
    #[arg(long, value_name = "DEG", help_heading = PLACEMENT, allow_hyphen_values = true)]
    roll: Option<f64>,
    /// Where the anchor lands in the view, mm; default: where it was drawn.
    #[arg(long, value_name = "X,Y", help_heading = PLACEMENT, allow_hyphen_values = true, value_parser = parse_point)]
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
    /// Points of the corrected lines: adaptive (as many as the tolerance needs, default) or keep (the drawing's own).
    #[arg(long, value_name = "WHICH", help_heading = CORRECTION)]
    vertices: Option<Vertices>,
    /// Greatest distance between corrected lines and the true curves, mm; default 0.01.
    #[arg(long, value_name = "MM", help_heading = CORRECTION)]
    tolerance: Option<f64>,
    /// Writes the report: what was read, what was assumed, how true every length is.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Draws the part with the drawing before and after; opens in any browser.
    #[arg(long, value_name = "FILE.svg")]
    preview: Option<PathBuf>,
    /// Prints the report, or the reason of a refusal, as JSON on standard output.
    #[arg(long)]
    pub(super) json: bool,
}

pub(super) fn run(arguments: &CorrectArguments) -> Outcome {
    let (part, pattern) = inputs(&arguments.inputs)?;
    let sku = sku(arguments, part)?;
    let mut live = arguments.station.as_deref().map(LiveSettings::open).transpose()?;
    let mut settings = match &mut live {
        Some(live) => live.job(&sku)?,
        None => JobSettings::default(),
    };
    arguments.apply(&mut settings)?;
    let cache = cache_of(arguments.cache.as_deref(), live.as_ref().map(LiveSettings::station))?;
    let pipeline = Pipeline::new(Some(cache));

    let drawing = read_file(pattern)?;
    let learned = match part {
        Some(part) => {
            let bytes = read_file(part)?;
            let input = PartInput { name: &name_of(part)?, bytes: &bytes, sibling: &mut sibling_of(part) };
            pipeline.learn(&sku, input, &settings.part)?
        }
        None => recall(&pipeline, &sku, &settings)?,
    };
    let previous =
        read_if_there(&arguments.out).map_err(|error| file_trouble("write", &arguments.out, &error))?;
    let input = PatternInput { name: &name_of(pattern)?, bytes: &drawing, previous: previous.as_deref() };
    let corrected = pipeline.correct(&sku, &learned, input, &settings, arguments.preview.is_some())?;

    write_file(&arguments.out, &corrected.dxf)?;
    let json = corrected.report.to_json().map_err(|error| Failure::environment(&error.into()))?;
    if let Some(path) = &arguments.report {
        write_file(path, json.as_bytes())?;
    }
    if let (Some(path), Some(picture)) = (&arguments.preview, &corrected.preview) {
        write_file(path, picture.as_bytes())?;
    }
    if arguments.json {
        print(&json);
    }
    tell(&corrected.report.summary());
    Ok(())
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

fn sku(arguments: &CorrectArguments, part: Option<&Path>) -> Result<Sku, Failure> {
    match (&arguments.sku, part.and_then(Path::file_stem)) {
        (Some(sku), _) => parse_sku(sku),
        (None, Some(stem)) => parse_sku(&stem.to_string_lossy()),
        (None, None) => Err(Failure::usage(
            "There is neither a part nor a SKU.",
            "Name the part, or its SKU with `--sku`.",
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

impl CorrectArguments {
    fn apply(&self, settings: &mut JobSettings) -> Outcome {
        fn set<T: Clone>(to: &mut T, given: Option<&T>) {
            if let Some(given) = given {
                to.clone_from(given);
            }
        }
        set(&mut settings.part.facing, self.facing.as_ref());
        set(&mut settings.part.roll, self.roll.map(f64::to_radians).as_ref());
        settings.part.unit = self.meaning.part_unit.or(settings.part.unit);
        settings.part.up = self.meaning.part_up.or(settings.part.up);
        settings.part.smoothing = self.scan.smoothing()?.unwrap_or(settings.part.smoothing);
        self.meaning.apply(&mut settings.pattern);
        if self.ink_layers.is_some() {
            settings.pattern.ink_layers.clone_from(&self.ink_layers);
        }
        settings.placement.place = self.place.map(|[x, y]| ViewPoint::new(x, y)).or(settings.placement.place);
        set(&mut settings.placement.anchor, self.anchor.as_ref());
        set(&mut settings.placement.rotate, self.rotate.map(f64::to_radians).as_ref());
        set(&mut settings.correction.method, self.method.as_ref());
        set(&mut settings.correction.weighting, self.weighting.as_ref());
        set(&mut settings.correction.vertices, self.vertices.as_ref());
        set(&mut settings.correction.tolerance, self.tolerance.as_ref());
        let tolerance = settings.correction.tolerance;
        if !(0.0001..=10.0).contains(&tolerance) {
            return Err(Failure::usage(
                format!("A tolerance of {tolerance} mm makes no sense."),
                "Give `--tolerance` between 0.0001 and 10 mm; 0.01 is usual.",
            ));
        }
        let angles = [settings.part.roll, settings.placement.rotate];
        if angles.iter().any(|angle| !angle.is_finite()) {
            return Err(Failure::usage(
                "An angle is not a number.",
                "Give `--rotate` and `--roll` in degrees.",
            ));
        }
        Ok(())
    }
}

fn parse_point(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<f64> = text.split(',').map_while(|part| f64::from_str(part.trim()).ok()).collect();
    match numbers[..] {
        [x, y] if text.matches(',').count() == 1 && x.is_finite() && y.is_finite() => Ok([x, y]),
        _ => Err("give two numbers in mm, as in 12.5,-3".into()),
    }
}

fn parse_anchor(text: &str) -> Result<Anchor, String> {
    match text {
        "center" => Ok(Anchor::Center),
        "origin" => Ok(Anchor::Origin),
        _ => parse_point(text)
            .map(|[x, y]| Anchor::At(FlatPoint::new(x, y)))
            .map_err(|_| "give center, origin, or a point of the drawing in mm, as in 12.5,-3".into()),
    }
}
