//! `isomark demo`: a station with sample parts and drawings, run once.

use std::path::{Path, PathBuf};

use clap::Args;
use fs_err as fs;

use super::outcome::{Failure, Outcome, print, shown, tell};
use super::progress::ProgressLine;
use super::shell;
use crate::cache::Cache;
use crate::config::LiveSettings;
use crate::files::write_whole;
use crate::hotfolder::{self, Mode, PipelineCorrector, StopSignal};
use crate::pipeline::Pipeline;
use crate::report::Report;

#[derive(Debug, Args)]
pub(super) struct DemoArguments {
    /// The folder to set the station up in.
    #[arg(default_value = "isomark-demo")]
    folder: PathBuf,
    /// Opens the report of the first drawing in the browser, with the mark on the part in 3-D.
    #[arg(long)]
    open: bool,
}

/// The settings of the station and of its sample parts.
const FILES: &[(&str, &[u8])] = &[
    ("station.toml", include_bytes!("../../watch-config/station.toml")),
    ("skus/can.toml", include_bytes!("../../examples/skus/can.toml")),
    ("skus/mouse.toml", include_bytes!("../../examples/skus/mouse.toml")),
    ("skus/mandarin.toml", include_bytes!("../../examples/skus/mandarin.toml")),
];
const DROPS: &[(&str, &[u8])] = &[
    ("mouse.glb", include_bytes!("../../examples/parts/mouse.glb")),
    ("can.glb", include_bytes!("../../examples/parts/can.glb")),
    ("mandarin.glb", include_bytes!("../../examples/parts/mandarin.glb")),
    ("mouse@letters.dxf", include_bytes!("../../examples/patterns/letters.dxf")),
    ("mouse@guilloche.dxf", include_bytes!("../../examples/patterns/guilloche.dxf")),
    ("can@letters.dxf", include_bytes!("../../examples/patterns/letters.dxf")),
    ("can@logo.toml", include_bytes!("../../examples/patterns/logo.toml")),
    ("can@logo.dxf", include_bytes!("../../examples/patterns/logo.dxf")),
    ("can@band.toml", include_bytes!("../../examples/patterns/band.toml")),
    ("can@band.dxf", include_bytes!("../../examples/patterns/band.dxf")),
    ("can@code.dxf", include_bytes!("../../examples/patterns/code.dxf")),
    ("mandarin@letters.dxf", include_bytes!("../../examples/patterns/letters.dxf")),
];

/// The page of the first drawing, in the reports folder.
const REPORT: &str = "mouse/mouse@letters.dxf.report.html";

pub(super) fn run(arguments: &DemoArguments) -> Outcome {
    super::log::start(None).map_err(|error| Failure::environment(&error))?;
    let folder = &arguments.folder;
    set_up(folder).map_err(|error| Failure::environment(&error))?;
    let settings = LiveSettings::open(&folder.join("station.toml"))?;
    let folders = settings.station().folders.clone();
    let progress = ProgressLine::start();
    let pipeline = Pipeline::new(Some(Cache::new(&folders.cache))).observed(progress.observer());
    let corrector = PipelineCorrector::new(pipeline);
    let tally = hotfolder::run(settings, &corrector, &StopSignal::default(), Mode::Once, &mut |_| {})
        .map_err(|error| Failure::new(super::Exit::Environment, error.reason()))?;
    drop(progress);
    let table = table(&folders.reports).map_err(|error| Failure::environment(&error))?;
    let page = folders.reports.join(REPORT);
    let how = if arguments.open { "" } else { " (`isomark demo --open` does that)" };
    print(&format!(
        "\nThe mark on the part in 3-D, with all results; open it in a browser{how}:\n  {}\n\
         \n{table}\n{} drawings delivered, {} rejected.\n\ncorrected drawings  {}\nreports, pictures   {}\nsettings            {}\n\
         \nDrop a part and a drawing into {} and run\n  {}\n",
        shown(&page),
        tally.delivered + tally.unchanged,
        tally.rejected,
        shown(&folders.import),
        shown(&folders.reports),
        shown(&folder.join("station.toml")),
        shown(&folders.hot),
        shell::command(&["watch", &shell::path(&folder.join("station.toml"))]),
    ));
    if arguments.open
        && let Err(error) = std::path::absolute(&page).and_then(open::that_detached)
    {
        tell(&format!("isomark: warning: no browser could be opened: {error}"));
    }
    Ok(())
}

fn set_up(folder: &Path) -> std::io::Result<()> {
    let hot = folder.join("hot");
    for each in [&hot, &folder.join("import"), &folder.join("skus")] {
        fs::create_dir_all(each)?;
    }
    for (name, bytes) in FILES {
        let path = folder.join(name);
        // Edited settings are kept.
        if path.exists() {
            continue;
        }
        if let (Some(parent), Some(name)) = (path.parent(), path.file_name()) {
            write_whole(parent, &name.to_string_lossy(), bytes)?;
        }
    }
    DROPS.iter().try_for_each(|(name, bytes)| write_whole(&hot, name, bytes))
}

/// A row for each report, in the order of the drops.
fn table(reports: &Path) -> std::io::Result<String> {
    let mut text = format!(
        "{:<10} {:<16} {:<10} {:>14} {:>22} {:>9}\n",
        "SKU", "drawing", "method", "residual mm", "length error mm", "work ms"
    );
    for (name, _) in DROPS {
        let Some((sku, _)) = name.split_once('@') else { continue };
        let path = reports.join(sku).join(format!("{name}.report.json"));
        let Ok(json) = fs::read_to_string(&path) else { continue };
        let report: Report = serde_json::from_str(&json)?;
        // A drawing that goes round is nowhere completely on the part before it is divided.
        let before = report.quality.before.as_ref();
        let before = before.map_or("-".to_owned(), |before| format!("{:.3}", before.length_error_mm));
        let change = format!("{before} -> {:.3}", report.quality.after.length_error_mm);
        text += &format!(
            "{:<10} {:<16} {:<10} {:>14.4} {:>22} {:>9.1}\n",
            report.sku,
            report.pattern.file.split_once('@').map_or(report.pattern.file.as_str(), |(_, drawing)| drawing),
            report.map.method(),
            report.part.residual.under_ink_mm,
            change,
            report.timings.iter().map(|timing| timing.ms).sum::<f64>(),
        );
    }
    Ok(text)
}
