//! The tiles of a mark that goes round the part, on the command line.

use std::path::{Path, PathBuf};

use clap::Args;

use super::named_files::{
    apart, beside, can_have_files_beside, file_trouble, is_device, name_of, tell_of_others, tell_of_stale,
    write_file, write_file_if,
};
use super::outcome::{Failure, Outcome};
use super::set::{add_options, add_switch};
use crate::config::Overrides;
use crate::formats::pattern::{self, is_dxf};
use crate::pipeline::{Corrected, TileFile, rotary_table};
use crate::report::RotaryReport;

const ROTARY: &str = "Mark round the part";

#[derive(Debug, Args)]
pub(super) struct RotaryArguments {
    /// Divides a mark that goes round a cylinder or cone into tiles, between which the part turns about its axis: auto (as
    /// few as possible, default), a number of tiles, or off. The drawing's x runs round the axis.
    #[arg(long, value_name = "TILES", num_args = 0..=1, require_equals = true, default_missing_value = "auto", help_heading = ROTARY)]
    rotary: Option<String>,
    /// How far two tiles overlap where a contour is cut, mm on the part, 0 to 10; default 0.
    #[arg(long, value_name = "MM", help_heading = ROTARY, allow_hyphen_values = true)]
    overlap: Option<String>,
    /// The widest tile, degrees about the axis, 1 to 178. Default: what incidence, focus and field allow.
    #[arg(long, value_name = "DEG", help_heading = ROTARY, allow_hyphen_values = true)]
    max_tile: Option<String>,
    /// How the tiles are written: layers (of one file, named after their angles, default) or files (one for each angle).
    #[arg(long, value_name = "HOW", help_heading = ROTARY)]
    tiles_as: Option<String>,
    /// The angles of the rotary axis grow in the other direction.
    #[arg(long, help_heading = ROTARY)]
    reverse: bool,
}

impl RotaryArguments {
    /// Refuses a number of tiles behind a blank, which is read as the name of a file.
    pub(super) fn refuse_blank(&self, files: &[&Path]) -> Outcome {
        let is_tiles = |name: &str| ["auto", "off"].contains(&name) || name.parse::<u16>().is_ok();
        let name = files
            .iter()
            .filter(|file| !file.exists())
            .find_map(|file| file.to_str().filter(|name| is_tiles(name)));
        match (self.rotary.as_deref(), name) {
            (Some("auto"), Some(name)) => Err(Failure::usage(
                format!("Behind `--rotary`, {name} is the name of a file, and there is no such file."),
                format!("Write an equals sign before the number of tiles: `--rotary={name}`."),
            )),
            _ => Ok(()),
        }
    }

    /// Adds the settings that were typed.
    pub(super) fn add_to(&self, overrides: &mut Overrides) -> Result<(), Failure> {
        add_options(
            overrides,
            &[
                ("--rotary", "rotary.tiles", self.rotary.as_ref()),
                ("--overlap", "rotary.overlap_mm", self.overlap.as_ref()),
                ("--max-tile", "rotary.max_tile_deg", self.max_tile.as_ref()),
                ("--tiles-as", "rotary.as", self.tiles_as.as_ref()),
            ],
        )?;
        add_switch(overrides, "--reverse", "rotary.reverse", self.reverse)
    }
}

fn file_of(out: &Path, tile: &TileFile) -> PathBuf {
    beside(out, &format!("{}.dxf", tile.name.to_lowercase()))
}

/// Writes the table of a mark in tiles beside the corrected drawing, and the tiles, if they are files. Returns whether
/// they are.
pub(super) fn write_tiles(
    out: &Path,
    corrected: &mut Corrected,
    read: &[&Path],
    is_read_back: bool,
) -> Result<bool, Failure> {
    let Some(mark) = corrected.report.rotary.as_mut() else {
        tell_of_others(out, 'r', &[]);
        return Ok(false);
    };
    can_have_files_beside(out)?;
    let files: Vec<PathBuf> = corrected.tile_files.iter().map(|tile| file_of(out, tile)).collect();
    let (csv, json) = (beside(out, "rotary.csv"), beside(out, "rotary.json"));
    let named = files.iter().chain([&csv, &json]).map(|file| ("--out", file.as_path()));
    apart(read, &named.collect::<Vec<_>>())?;
    for (index, tile) in mark.tiles.iter_mut().enumerate() {
        tile.file = Some(name_of(files.get(index).map_or(out, PathBuf::as_path))?);
    }
    for file in &files {
        refuse_to_lose(file)?;
    }
    for (tile, file) in corrected.tile_files.iter().zip(&files) {
        if is_read_back {
            write_file_if(file, &tile.dxf, |bytes| {
                pattern::read_back(bytes, &tile.drawing, corrected.profile).map_err(|error| error.reason())
            })?;
        } else {
            write_file(file, &tile.dxf)?;
        }
    }
    if !files.is_empty() {
        corrected.report.output.read_back = is_read_back;
    }
    let Some(mark) = &corrected.report.rotary else { return Ok(false) };
    write_table(mark, &corrected.report.sku, &corrected.report.pattern.file, [&csv, &json])?;
    tell_of_others(out, 'r', &files);
    // The layers of an earlier mark are in one file.
    let whole = name_of(out)?;
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tell_of_stale(folder, |name| !files.is_empty() && name == whole);
    Ok(!files.is_empty())
}

fn write_table(mark: &RotaryReport, sku: &str, pattern: &str, [csv, json]: [&Path; 2]) -> Outcome {
    let table = rotary_table(sku, pattern, mark);
    write_file(csv, table.to_csv().as_bytes())?;
    let text = table.to_json().map_err(|error| Failure::environment(&error.into()))?;
    write_file(json, text.as_bytes())
}

/// Refuses to replace a file that is not a drawing.
fn refuse_to_lose(file: &Path) -> Outcome {
    if is_device(file) {
        return Ok(());
    }
    let previous = crate::files::read_if_there(file).map_err(|error| file_trouble("write", file, &error))?;
    match previous.filter(|bytes| !bytes.is_empty() && !is_dxf(bytes)) {
        None => Ok(()),
        Some(_) => Err(Failure::usage(
            format!("The tile {} would replace a file that is not a DXF.", file.display()),
            "Give `--out` another name, or remove the file that is there.",
        )),
    }
}
