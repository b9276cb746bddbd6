//! `isomark correct`: one drawing for one part.

use std::path::{Path, PathBuf};

use clap::Args;

use super::job::{Job, JobArguments};
use super::list;
use super::named_files::{
    apart, beside, can_have_files_beside, file_trouble, is_device, name_of, tell_of_others, write_file,
    write_file_if,
};
use super::outcome::{Failure, Outcome, print_json, tell};
use super::rotary::{RotaryArguments, write_tiles};
use super::set::{add_options, refuse_without_steps, useless_to_a_job, without_effect};
use crate::config::{Overrides, Tiles, TilesAs};
use crate::files::read_if_there;
use crate::formats::mesh::MeshFormat;
use crate::formats::pattern::{is_dxf, write_points, write_space};
use crate::pipeline::{Corrected, PatternInput};
use crate::preview::{self, PartSource};
use crate::report_html::{self, PageContent};

const CORRECTION: &str = "Correction";
/// What an operator does about a picture without the part's own mesh.
const WITHOUT_MESH: &str = "shows only the side that faces the laser, because the part's mesh is not kept: name the part before the drawing";

#[derive(Debug, Args)]
#[command(
    override_usage = "isomark correct [OPTIONS] --out <OUT.dxf> <PART> <DRAWING>\n       isomark correct [OPTIONS] --out <OUT.dxf> --sku <SKU> <DRAWING>\n       isomark correct [OPTIONS] --out <OUT.dxf> --cylinder <D,LENGTH> <DRAWING>"
)]
pub(super) struct CorrectArguments {
    #[command(flatten)]
    job: JobArguments,
    #[command(flatten)]
    rotary: RotaryArguments,
    /// The corrected drawing to write; an existing drawing is replaced.
    #[arg(long, short, value_name = "OUT.dxf", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// Writes a drawing for each row of this list (CSV; the first row names the columns) into `--out-dir`: LIST-0001.dxf and so on.
    /// Fields `{csv:COLUMN}` are from the row; serial numbers as set under `[serial]`.
    #[arg(
        long,
        value_name = "LIST.csv",
        help_heading = "Variable content",
        conflicts_with_all = ["out", "report", "preview", "on_part", "report_html", "frame_drawing", "xyz", "step_files"]
    )]
    list: Option<PathBuf>,
    /// The folder for the drawings of a list; it is created if need be, and drawings in it are replaced.
    #[arg(long, value_name = "DIR", help_heading = "Variable content", requires = "list")]
    out_dir: Option<PathBuf>,
    /// How the drawing is bent: auto (exact on cylinders and cones, otherwise isometric), isometric, cylinder, cone; to
    /// compare with: mapping-domain, floater, none.
    #[arg(long, help_heading = CORRECTION)]
    method: Option<String>,
    /// Where `isometric` keeps lengths truest: on the ink (default), or uniform over the drawing's rectangle.
    #[arg(long, help_heading = CORRECTION)]
    weighting: Option<String>,
    /// What is kept truest on the ink where the part is curved in two directions: balanced (default), lengths of lines, areas, or
    /// shapes (angles). `isomark evaluate` compares them.
    #[arg(long, value_name = "WHAT", help_heading = CORRECTION)]
    aim: Option<String>,
    /// Factor on the weight of lengths, 0.1 to 10; use `--aim` instead.
    #[arg(long, value_name = "TIMES", hide = true, allow_hyphen_values = true)]
    length_weight: Option<String>,
    /// Factor on the weight of angles, 0.1 to 10; use `--aim` instead.
    #[arg(long, value_name = "TIMES", hide = true, allow_hyphen_values = true)]
    angle_weight: Option<String>,
    /// How many points corrected lines get: adaptive (as many as the tolerance needs, default) or keep (the drawing's own).
    #[arg(long, value_name = "WHICH", help_heading = CORRECTION)]
    vertices: Option<String>,
    /// Greatest distance between corrected lines and the true curves, mm, 0.0001 to 1; default 0.01.
    #[arg(long, value_name = "MM", help_heading = CORRECTION, allow_hyphen_values = true)]
    tolerance: Option<String>,
    /// Fills closed contours and solid hatches with lines this far apart on the part, mm, 0.005 to 10; with one or two directions in
    /// degrees, as in 0.05,45,135. Default: as set under `[fill]`, which fills nothing.
    #[arg(long, value_name = "MM[,DEG[,DEG]]", help_heading = CORRECTION, allow_hyphen_values = true)]
    fill: Option<String>,
    /// Writes the report: what was read, what was assumed, and how true every length is.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Draws the part with the drawing before and after; any browser shows it.
    #[arg(long, value_name = "FILE.svg")]
    preview: Option<PathBuf>,
    /// Writes the part with the mark on it in three dimensions, for CAD, Blender and browsers; lines have the colours of
    /// the preview.
    #[arg(long, value_name = "FILE.glb")]
    on_part: Option<PathBuf>,
    /// Writes the report as a page for people: the mark on the part in 3-D, the main values, the preview and all notices.
    /// Any browser shows it, without a network.
    #[arg(long, value_name = "FILE.html")]
    report_html: Option<PathBuf>,
    /// Writes the outline of the ink and its box, as they are on the part, for the pilot beam: trace it before marking.
    #[arg(long, value_name = "FILE.dxf")]
    frame_drawing: Option<PathBuf>,
    /// Writes the drawing on the part for a head with three axes: x, y and z of every point in the laser's frame, mm, as a list (.csv) or
    /// as polylines in space (.dxf).
    #[arg(long, value_name = "FILE.csv|FILE.dxf")]
    xyz: Option<PathBuf>,
    /// With steps of focus (`--set focus.steps=layers`), writes each step into a file of its own beside OUT as well, named after its
    /// height, such as OUT.z+001.500.dxf.
    #[arg(long)]
    step_files: bool,
    /// Prints the report, or the reason for a rejection, as JSON on standard output.
    #[arg(long)]
    pub(super) json: bool,
}

/// Extensions of files that are never DXF drawings, beside those of parts. `--out` may have any other extension or none.
const OTHER_KINDS: &[&str] = &["svg", "png", "bmp", "jpg", "jpeg", "pdf", "json", "html", "toml"];

pub(super) fn run(arguments: &CorrectArguments) -> Outcome {
    let out = match (&arguments.out, &arguments.list) {
        (Some(out), _) => out,
        (None, Some(list)) => return arguments.run_list(list),
        (None, None) => return Err(Failure::usage("No drawing to write is named.", "Name it with `--out`.")),
    };
    // clap drops the requirement, because `--out` and the list that is missing exclude each other.
    if arguments.out_dir.is_some() {
        let why = "it is for the drawings of a list";
        return Err(without_effect(
            "--out-dir",
            why,
            "Remove it, or name the list with `--list` instead of `--out`.",
        ));
    }
    let named = [
        ("--out", Some(out)),
        ("--report", arguments.report.as_ref()),
        ("--preview", arguments.preview.as_ref()),
        ("--on-part", arguments.on_part.as_ref()),
        ("--report-html", arguments.report_html.as_ref()),
        ("--frame-drawing", arguments.frame_drawing.as_ref()),
        ("--xyz", arguments.xyz.as_ref()),
    ];
    let written: Vec<(&str, &Path)> =
        named.iter().filter_map(|(option, file)| file.map(|file| (*option, file.as_path()))).collect();
    apart(&arguments.job.files(), &written)?;
    let pictures = [
        ("--preview", arguments.preview.as_ref(), "svg", "an SVG picture"),
        ("--on-part", arguments.on_part.as_ref(), "glb", "a binary glTF file"),
        ("--report-html", arguments.report_html.as_ref(), "html", "an HTML page"),
        ("--frame-drawing", arguments.frame_drawing.as_ref(), "dxf", "a DXF drawing"),
    ];
    for (option, file, ending, kind) in pictures {
        check_extension(option, file, &[ending], kind)?;
    }
    let is_of_other_kind = |file: &&PathBuf| {
        MeshFormat::from_name(&file.to_string_lossy()).is_some()
            || OTHER_KINDS.iter().any(|kind| has_ending(file, kind))
    };
    let out_of_other_kind = Some(out).filter(is_of_other_kind);
    check_extension("--out", out_of_other_kind, &["dxf"], "a DXF drawing")?;
    check_extension("--xyz", arguments.xyz.as_ref(), &["csv", "dxf"], "a list of points or a DXF")?;
    let previous = replaced(out)?;
    arguments.rotary.refuse_blank(&arguments.job.files())?;
    let job = arguments.job.prepare(arguments.overrides()?, useless_to_a_job)?;
    let Job { sku, settings, pipeline, learned, pattern, drawing, beside_part, verify, progress: _ } = &job;
    if arguments.step_files {
        refuse_without_steps("--step-files", settings)?;
    }
    let with_pictures = pictures.iter().any(|(_, file, ..)| file.is_some()) || arguments.xyz.is_some();
    let input = PatternInput { name: &name_of(pattern)?, bytes: drawing, previous: previous.as_deref() };
    let mut corrected = pipeline.correct(sku, learned, input, settings, with_pictures)?;

    let steps = arguments.steps(out, &corrected);
    if !steps.is_empty() {
        can_have_files_beside(out)?;
    }
    let named_steps = steps.iter().map(|(file, _)| ("--step-files", file.as_path()));
    let read: Vec<&Path> =
        arguments.job.files().into_iter().chain(beside_part.iter().map(PathBuf::as_path)).collect();
    apart(&read, &written.iter().copied().chain(named_steps).collect::<Vec<_>>())?;
    let dxf = std::mem::take(&mut corrected.dxf);
    let is_read_back = corrected.is_to_be_read_back(*verify);
    if write_tiles(out, &mut corrected, &arguments.job.files(), is_read_back)? {
        // The tiles are files of their own.
    } else if is_read_back {
        write_file_if(out, &dxf, |file| corrected.read_back(file))?;
    } else {
        write_file(out, &dxf)?;
    }
    for (file, dxf) in &steps {
        write_file(file, dxf)?;
    }
    if arguments.step_files {
        tell_of_others(out, 'z', &steps.into_iter().map(|(file, _)| file).collect::<Vec<_>>());
    }
    if let (Some(path), Some(drawing)) = (&arguments.xyz, pipeline.in_space(learned, &corrected, settings)) {
        let bytes = if has_ending(path, "csv") { write_points(&drawing) } else { write_space(&drawing) };
        write_file(path, &bytes)?;
    }
    let json = corrected.report.to_json().map_err(|error| Failure::environment(&error.into()))?;
    if let Some(path) = &arguments.report {
        write_file(path, json.as_bytes())?;
    }
    if let (Some(path), Some(frame)) = (&arguments.frame_drawing, &corrected.frame) {
        write_file(path, &frame.dxf())?;
    }
    let shows_heights = arguments.write_pictures(&job, &corrected)?;
    if arguments.json {
        print_json(&json);
    }
    tell(&corrected.report.summary_replacing(&name_of(out)?));
    if shows_heights {
        let option = if arguments.on_part.is_some() { "--on-part" } else { "--report-html" };
        tell(&format!("`{option}` {WITHOUT_MESH}"));
    }
    Ok(())
}

/// Refuses a file whose name has the extension of another kind of file.
pub(super) fn check_extension(
    option: &str,
    file: Option<&PathBuf>,
    extensions: &[&str],
    kind: &str,
) -> Outcome {
    let is_other = |file: &&PathBuf| !extensions.iter().any(|extension| has_ending(file, extension));
    match file.filter(is_other) {
        None => Ok(()),
        Some(file) => Err(Failure::usage(
            format!("`{option}` writes {kind}, and {} has another extension.", file.display()),
            format!("Give the file the extension .{}.", extensions.join(" or .")),
        )),
    }
}

pub(super) fn has_ending(file: &Path, ending: &str) -> bool {
    file.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

/// The drawing that the corrected one replaces, if any. Refuses to replace a file that is not a drawing; an empty file
/// loses nothing, nor does a device.
fn replaced(out: &Path) -> Result<Option<Vec<u8>>, Failure> {
    if is_device(out) {
        return Ok(None);
    }
    let previous = read_if_there(out).map_err(|error| file_trouble("write", out, &error))?;
    if previous.as_ref().is_some_and(|bytes| !bytes.is_empty() && !is_dxf(bytes)) {
        return Err(Failure::usage(
            format!("`--out` names {}, which is not a DXF and would be lost.", out.display()),
            "Give `--out` the name of a DXF file, or remove the file that is there.",
        ));
    }
    Ok(previous)
}

impl CorrectArguments {
    /// Writes the pictures that the options name; returns whether one of them lacks the part's mesh.
    fn write_pictures(&self, job: &Job, corrected: &Corrected) -> Result<bool, Failure> {
        let Corrected { preview: Some(flat), marked: Some(marked), landmarks: Some(landmarks), .. } =
            corrected
        else {
            return Ok(false);
        };
        let panels = (self.preview.is_some() || self.report_html.is_some()).then(|| preview::svg(flat));
        if let (Some(path), Some(panels)) = (&self.preview, &panels) {
            write_file(path, panels.as_bytes())?;
        }
        if self.on_part.is_none() && self.report_html.is_none() {
            return Ok(false);
        }
        let on_part = job.pipeline.on_part(&job.learned, marked);
        let glb = preview::glb(&on_part);
        if let Some(path) = &self.on_part {
            write_file(path, &glb)?;
        }
        if let (Some(path), Some(panels)) = (&self.report_html, &panels) {
            let report = &corrected.report;
            let content = PageContent { report, panels, on_part: &on_part, glb: &glb, landmarks };
            write_file(path, report_html::html(&content).as_bytes())?;
        }
        Ok(on_part.part_source == PartSource::Heights && job.learned.kept.facts.scan.is_none())
    }

    /// Corrects the drawing for each row of a list.
    fn run_list(&self, list: &Path) -> Outcome {
        let folder = list::folder(list, self.out_dir.as_ref())?;
        if self.job.content.gives_a_product() {
            return Err(Failure::usage(
                "`--content` gives the values of one product, and `--list` those of many.",
                "Remove `--content`, or `--list`; the first serial number of a list is `--set serial.start=17`.",
            ));
        }
        let job = self.job.prepare(self.overrides()?, useless_to_a_job)?;
        let rotary = &job.settings.rotary;
        if rotary.tiles != Tiles::Off && rotary.written_as == TilesAs::Files {
            return Err(Failure::usage(
                "`--list` writes one drawing for each row, and the tiles are to be files (`--tiles-as files`, `as` under [rotary]).",
                "Give `--tiles-as layers`, or correct the drawings one by one.",
            ));
        }
        list::run(&job, list, &self.job.files(), &folder, self.json)
    }

    /// The files of the steps of focus, if they are asked for.
    fn steps(&self, out: &Path, corrected: &Corrected) -> Vec<(PathBuf, Vec<u8>)> {
        let file = |(height, dxf)| (beside(out, &format!("{height}.dxf")), dxf);
        if self.step_files { corrected.step_files().map(file).collect() } else { Vec::new() }
    }

    /// The settings of options that only this command has.
    fn overrides(&self) -> Result<Overrides, Failure> {
        let mut overrides = Overrides::default();
        add_options(
            &mut overrides,
            &[
                ("--method", "correction.method", self.method.as_ref()),
                ("--weighting", "correction.weighting", self.weighting.as_ref()),
                ("--aim", "correction.aim", self.aim.as_ref()),
                ("--length-weight", "correction.length_weight", self.length_weight.as_ref()),
                ("--angle-weight", "correction.angle_weight", self.angle_weight.as_ref()),
                ("--vertices", "correction.vertices", self.vertices.as_ref()),
                ("--tolerance", "correction.tolerance_mm", self.tolerance.as_ref()),
            ],
        )?;
        if let Some(fill) = &self.fill {
            let option = format!("--fill {fill}");
            let given: Vec<&str> = fill.split(',').map(str::trim).collect();
            let keys = ["fill.spacing_mm", "fill.angle_deg", "fill.second_angle_deg"];
            if given.len() > keys.len() {
                return Err(Failure::usage(
                    format!("`{option}` gives more than a distance and two directions."),
                    "Give the distance of the lines in mm, and one or two directions in degrees, as in 0.05,45,135.",
                ));
            }
            for (key, value) in keys.into_iter().zip(given) {
                overrides.add(&option, key, value)?;
            }
        }
        self.rotary.add_to(&mut overrides)?;
        Ok(overrides)
    }
}
