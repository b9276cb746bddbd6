//! `isomark correct`: one drawing for one part.

use std::path::{Path, PathBuf};

use clap::Args;

use super::job::{Job, JobArguments, set};
use super::named_files::{apart, file_trouble, name_of, write_file, write_file_if};
use super::outcome::{Failure, Outcome, print_json, tell};
use crate::config::{CorrectionSettings, JobSettings, Method, Vertices, Weighting};
use crate::files::read_if_there;
use crate::pipeline::PatternInput;
use crate::preview;

const CORRECTION: &str = "Correction";

#[derive(Debug, Args)]
#[command(
    override_usage = "isomark correct [OPTIONS] --out <OUT.dxf> <PART> <PATTERN>\n       isomark correct [OPTIONS] --out <OUT.dxf> --sku <SKU> <PATTERN>\n       isomark correct [OPTIONS] --out <OUT.dxf> --cylinder <D,LENGTH> <PATTERN>"
)]
pub(super) struct CorrectArguments {
    #[command(flatten)]
    job: JobArguments,
    /// The corrected drawing to write.
    #[arg(long, short, value_name = "OUT.dxf")]
    out: PathBuf,
    /// How the drawing is bent: auto (exact on cylinders and cones, otherwise isometric), isometric, cylinder, cone, or
    /// to compare with mapping-domain, floater, none.
    #[arg(long, help_heading = CORRECTION)]
    method: Option<Method>,
    /// Where `isometric` keeps lengths first: on the ink (default), or uniform over the drawing's rectangle.
    #[arg(long, help_heading = CORRECTION)]
    weighting: Option<Weighting>,
    /// How many times as much the lengths of lines count when the ink does, 0.1 to 10.
    #[arg(long, value_name = "TIMES", help_heading = CORRECTION)]
    length_weight: Option<f64>,
    /// How many times as much angles count when the ink does, 0.1 to 10: shapes get truer, lengths less so.
    #[arg(long, value_name = "TIMES", help_heading = CORRECTION)]
    angle_weight: Option<f64>,
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
    let named = [
        ("--out", Some(&arguments.out)),
        ("--report", arguments.report.as_ref()),
        ("--preview", arguments.preview.as_ref()),
    ];
    let written: Vec<(&str, &Path)> =
        named.iter().filter_map(|(option, file)| file.map(|file| (*option, file.as_path()))).collect();
    apart(&arguments.job.files(), &written)?;
    let job = arguments.job.prepare(|settings| arguments.apply(settings))?;
    let Job { sku, settings, pipeline, learned, pattern, drawing, verify } = &job;
    let previous =
        read_if_there(&arguments.out).map_err(|error| file_trouble("write", &arguments.out, &error))?;
    let input = PatternInput { name: &name_of(pattern)?, bytes: drawing, previous: previous.as_deref() };
    let mut corrected = pipeline.correct(sku, learned, input, settings, arguments.preview.is_some())?;

    let dxf = std::mem::take(&mut corrected.dxf);
    if corrected.is_to_be_read_back(*verify) {
        write_file_if(&arguments.out, &dxf, |file| corrected.read_back(file))?;
    } else {
        write_file(&arguments.out, &dxf)?;
    }
    let json = corrected.report.to_json().map_err(|error| Failure::environment(&error.into()))?;
    if let Some(path) = &arguments.report {
        write_file(path, json.as_bytes())?;
    }
    if let (Some(path), Some(picture)) = (&arguments.preview, &corrected.preview) {
        write_file(path, preview::svg(picture).as_bytes())?;
    }
    if arguments.json {
        print_json(&json);
    }
    tell(&corrected.report.summary());
    Ok(())
}

impl CorrectArguments {
    fn apply(&self, settings: &mut JobSettings) -> Outcome {
        set(&mut settings.correction.method, self.method.as_ref());
        set(&mut settings.correction.weighting, self.weighting.as_ref());
        set(&mut settings.correction.length_weight, self.length_weight.as_ref());
        set(&mut settings.correction.angle_weight, self.angle_weight.as_ref());
        for weight in [settings.correction.length_weight, settings.correction.angle_weight] {
            if !CorrectionSettings::WEIGHTS.contains(&weight) {
                return Err(Failure::usage(
                    format!("A weight of {weight} is out of range."),
                    "Give `--length-weight` and `--angle-weight` between 0.1 and 10; 1 is usual.",
                ));
            }
        }
        set(&mut settings.correction.vertices, self.vertices.as_ref());
        set(&mut settings.correction.tolerance, self.tolerance.as_ref());
        let tolerance = settings.correction.tolerance;
        if !(0.0001..=10.0).contains(&tolerance) {
            return Err(Failure::usage(
                format!("A tolerance of {tolerance} mm makes no sense."),
                "Give `--tolerance` between 0.0001 and 10 mm; 0.01 is usual.",
            ));
        }
        Ok(())
    }
}
