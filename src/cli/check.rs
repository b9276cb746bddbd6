//! `isomark check` and `isomark init`: checks settings before they are used, and sets up a first station.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use clap::Args;
use fs_err as fs;

use super::named_files::share_is_there;
use super::outcome::{Exit, Failure, Outcome, print, shown};
use super::set::SetArguments;
use super::shell;
use crate::config::{
    ConfigError, DeliveryKind, FolderPaths, JobSettings, Sku, Station, TilesAs, is_reserved_by_windows,
    misnamed_settings, read_settings,
};
use crate::files::{temporary, write_whole};
use crate::hotfolder::names::is_ignored;
use crate::hotfolder::{self, StationLock, UsedFolder, is_hot_folder_held};
use crate::pipeline::{check_fixed_codes, misspelt_fields};
use crate::printable::on_one_line;
use crate::reason::{Notice, Reason};
use crate::report::LensTableReport;

#[derive(Debug, Args)]
pub(super) struct CheckArguments {
    /// The station's settings.
    station: PathBuf,
    #[command(flatten)]
    set: SetArguments,
}

#[derive(Debug, Args)]
pub(super) struct InitArguments {
    /// The folder to set the station up in; files that exist there are kept.
    folder: PathBuf,
}

/// The samples, with every key explained.
const FILES: &[(&str, &[u8])] = &[
    ("station.toml", include_bytes!("../../watch-config/station.toml")),
    ("skus/can-500.toml", include_bytes!("../../watch-config/skus/can-500.toml")),
];

pub(super) fn run(arguments: &CheckArguments) -> Outcome {
    let station = Station::load_with(&arguments.station, &arguments.set.of_station()?)?;
    share_is_there(&station, UsedFolder::Skus)?;
    share_is_there(&station, UsedFolder::Cache)?;
    let mut without_effect = Vec::from_iter(tiles_as_files(&arguments.station, &station.settings));
    let (mut mistakes, mut checked) = (Vec::new(), BTreeMap::new());
    for path in sku_files(&station.folders.skus)? {
        match check_sku_file(&station, &path) {
            Ok((sku, settings)) => {
                // A SKU has what the station has.
                if station.settings.rotary.written_as != TilesAs::Files {
                    without_effect.extend(tiles_as_files(&path, &settings));
                }
                if let Some(other) = checked.insert(sku, path.clone()) {
                    mistakes.push(ConfigError::Twice { file: path, other }.into());
                }
            }
            Err(failure) => mistakes.push(failure),
        }
    }
    let mut unread = Vec::new();
    for path in unread_files(&station.folders.skus) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match misnamed_settings(&name).and_then(|stem| stem.parse::<Sku>().ok()) {
            Some(sku) if !checked.contains_key(&sku) => {
                mistakes.push(ConfigError::Misnamed { file: path, sku }.into());
            }
            _ => {
                let message =
                    format!("{} is not read: settings of a SKU have the name SKU.toml", path.display());
                unread.push(Notice::warning("settings-unread", message));
            }
        }
    }
    if let Err(reason) = check_fixed_codes(&station.settings.content) {
        let reason = reason.in_file(arguments.station.display().to_string());
        mistakes.push(Failure::new(Exit::Usage, reason));
    }
    let skus = checked.len();
    mistakes.extend(station.folders.import_trouble().map(|reason| Failure::new(Exit::Usage, reason)));
    refuse_for(mistakes)?;
    let mut troubles = unwritable(&station.folders);
    if let Err(error) = fs::read_dir(&station.folders.hot)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        let what = format!("The hot folder cannot be listed: {error}.");
        let remedy = "Give the user that runs the station the right to read it, or name another folder.";
        troubles.push(Reason::new("folder-unreadable", what, remedy));
    }
    // The station itself may be running.
    let is_running = StationLock::holder(&station.folders.state).is_ok_and(|holder| holder.is_some());
    if !is_running && is_hot_folder_held(&station.folders.hot) {
        let what = format!("Another station uses the hot folder {} now.", station.folders.hot.display());
        let remedy = "Stop that station first, or give this one its own `hot` and `state` folders.";
        troubles.push(Reason::new("hot-folder-held", what, remedy));
    }
    if let Some(log) = &station.log
        && log.file.is_dir()
    {
        let what = format!("The log {} is a folder.", log.file.display());
        troubles.push(Reason::new("log-is-folder", what, "Name a file in it."));
    }
    troubles.extend(station.page.as_ref().and_then(hotfolder::page_trouble));
    refuse_for(troubles.into_iter().map(|reason| Failure::new(Exit::Environment, reason)).collect())?;
    let plural = if skus == 1 { "file" } else { "files" };
    print(&format!("{}: {} and {skus} SKU {plural} are valid\n", station.name, shown(&arguments.station)));
    let folders = &station.folders;
    print(&format!("  drops from  {}\n  results to  {}\n", shown(&folders.hot), shown(&folders.import)));
    if Some(folders.import.as_path()) == arguments.station.parent().map(|base| base.join("import")).as_deref()
    {
        print(
            "  note        `import` is the station's own folder: set it to the folder that the marking software imports from, or \
             let the marking software import from this one\n",
        );
    }
    if station.settings.optics.lens_is_assumed {
        print(
            "  note        the lens is not stated, so that a telecentric one is assumed; standard f-theta lenses are not telecentric: \
             measure it with `isomark calibrate lens`, or state `kind = \"telecentric\"` under [optics]\n",
        );
    }
    let mut notices = misspelt_fields(&station.settings.content);
    notices.extend(without_effect);
    notices.extend(unread);
    if let Some(lens) = station.settings.optics.lens.measured() {
        let table = LensTableReport::from(lens.residuals());
        print(&format!("  lens table  {}\n", table.summary()));
        notices.extend(table.notice());
    }
    for notice in &notices {
        print(&format!("  warning     {} [{}]\n", on_one_line(&notice.message), notice.code));
    }
    if let Some(page) = &station.page {
        print(&format!("  page        {}\n", on_one_line(&page.shown_address())));
    }
    if station.delivery.kind == DeliveryKind::Beamserver {
        print(&format!("  BeamServer  {}\n", on_one_line(&station.delivery.address)));
    }
    Ok(())
}

/// Writes all failures, if there are any, and ends with the last one.
fn refuse_for(mut failures: Vec<Failure>) -> Outcome {
    let Some(last) = failures.pop() else { return Ok(()) };
    failures.iter().for_each(Failure::tell);
    Err(last)
}

/// The folders into which this user cannot write. A folder that does not exist yet is made and removed again: only that shows
/// whether it can be made.
fn unwritable(folders: &FolderPaths) -> Vec<Reason> {
    let FolderPaths { hot, import, archive, rejected, cache, reports, state, skus: _ } = folders;
    let all = [
        ("hot", hot),
        ("import", import),
        ("archive", archive),
        ("rejected", rejected),
        ("cache", cache),
        ("reports", reports),
        ("state", state),
    ];
    let trouble = |(purpose, path): (&str, &PathBuf)| {
        let (error, is_made) = match make_for_a_moment(path) {
            Ok(()) => return None,
            Err(failed) => failed,
        };
        let cannot = if is_made { "written" } else { "made" };
        let what = format!("The {purpose} folder {} cannot be {cannot}: {error}.", path.display());
        let remedy = match is_made {
            true => "Give the user that runs the station the right to write into it, or name another folder.",
            false => {
                "Connect its share, give the user that runs the station the right to make it, or name another folder."
            }
        };
        Some(Reason::new("folder-unwritable", what, remedy))
    };
    all.into_iter().filter_map(trouble).collect()
}

/// Makes a folder, if there is none, writes a file into it, and removes what was made. The error states whether the folder is
/// there or could be made.
fn make_for_a_moment(path: &Path) -> Result<(), (std::io::Error, bool)> {
    let full = std::path::absolute(path).map_err(|error| (error, false))?;
    // Windows makes no folder of this name, or opens a device.
    let reserved = full.components().find(
        |part| matches!(part, Component::Normal(name) if is_reserved_by_windows(&name.to_string_lossy())),
    );
    if let Some(name) = reserved.filter(|_| cfg!(windows)) {
        let what = format!("Windows reserves the name {}", name.as_os_str().display());
        return Err((std::io::Error::new(std::io::ErrorKind::InvalidFilename, what), false));
    }
    let missing: Vec<&Path> = full.ancestors().take_while(|folder| !folder.exists()).collect();
    let mut made = Vec::new();
    let mut outcome = Ok(());
    for folder in missing.iter().rev() {
        if let Err(error) = fs::create_dir(folder) {
            outcome = Err((error, false));
            break;
        }
        made.push(*folder);
    }
    if outcome.is_ok() {
        outcome = temporary(&full).map(drop).map_err(|error| (error, true));
    }
    // Only empty folders are removed: a station may have been started meanwhile.
    made.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
    outcome
}

fn sku_files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Failure::environment(&error)),
    };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")));
    files.sort();
    Ok(files)
}

/// The files in the folder of the SKU files that nothing reads, except those of the system and of editors.
fn unread_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_unread = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.is_file() && !is_ignored(&name) && !name.to_lowercase().ends_with(".toml")
    };
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_unread).collect();
    files.sort();
    files
}

/// Warns of tiles in files of their own, which a station does not write.
fn tiles_as_files(file: &Path, settings: &JobSettings) -> Option<Notice> {
    (settings.rotary.written_as == TilesAs::Files).then(|| {
        let message = format!(
            "`as = \"files\"` under [rotary] in {} has no effect in a station, which delivers the tiles as layers of one file: remove \
             it, or write the files with `isomark correct --station`",
            file.display()
        );
        Notice::warning("tiles-as-unused", message)
    })
}

fn check_sku_file(station: &Station, path: &Path) -> Result<(Sku, JobSettings), Failure> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let sku = stem
        .parse::<Sku>()
        .map_err(|error| Failure::new(Exit::Usage, error.reason().in_file(path.display().to_string())))?;
    let text = read_settings(path)?;
    let settings = station.settings.overridden_by(path, &text)?;
    check_fixed_codes(&settings.content)
        .map_err(|reason| Failure::new(Exit::Usage, reason.in_file(path.display().to_string())))?;
    Ok((sku, settings))
}

pub(super) fn init(arguments: &InitArguments) -> Outcome {
    let folder = &arguments.folder;
    let failed = |error: std::io::Error| Failure::environment(&error);
    for name in ["hot", "import", "skus"] {
        fs::create_dir_all(folder.join(name)).map_err(failed)?;
    }
    for (name, bytes) in FILES {
        // With the separators of this system.
        let path: PathBuf = folder.join(name).components().collect();
        let verb = if path.exists() { "kept" } else { "written" };
        if let (false, Some(parent), Some(name)) = (path.exists(), path.parent(), path.file_name()) {
            write_whole(parent, &name.to_string_lossy(), bytes).map_err(failed)?;
        }
        print(&format!("{verb:<8} {}\n", shown(&path)));
    }
    let station = folder.join("station.toml");
    let file = shell::path(&station);
    print(&format!(
        "\nSet the import folder and the size of the field in {}, then\n  {}\n  {}\n",
        shown(&station),
        shell::command(&["check", &file]),
        shell::command(&["watch", &file])
    ));
    Ok(())
}
