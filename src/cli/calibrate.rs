//! `isomark calibrate lens`: the test drawing for the lens, and the lens from what was measured on it.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use fs_err as fs;
use nalgebra::Vector2;
use serde::Serialize;

use super::named_files::{apart, read_file, write_file};
use super::outcome::{Failure, Outcome, print, print_json, shown};
use super::set::SetArguments;
use super::shell;
use super::station_edit::{self, Change};
use crate::config::{LENS_TABLE_COLUMNS, NewValue, Station, read_lens_table};
use crate::formats::measurements::{Measurements, MeasurementsError, unit_of_scale};
use crate::formats::pattern;
use crate::geometry::optics::calibration::{
    CalibrationError, CrossReading, DistanceReading, LeftOut, LensCalibration, LensReadings, ReadingPlace,
    Uncertain,
};
use crate::geometry::space::{Extents, FieldPoint};
use crate::pipeline::{profile, program};
use crate::printable::on_one_line;
use crate::reason::{Notice, Reason};
use crate::report::LensTableReport;
use test_drawing::{Cross, crosses};

mod picture;
mod test_drawing;

/// Name and version of the JSON form of a [`LensDocument`].
const SCHEMA: &str = "isomark.lens/1";
/// A scale is worth a notice if it differs from 1 by more than this. [`SURE`] must hold, too.
const NOTABLE_SCALE: f64 = 0.001;
/// A scale is worth a notice if it differs from 1 by more than this number of standard deviations.
/// [`NOTABLE_SCALE`] must hold, too.
const SURE: f64 = 3.0;
/// A scale that differs from 1 by more than this is a mistake: no marking software is calibrated so badly.
const WRONG_SCALE: f64 = 0.2;
/// The same limit if a wrong number of crosses explains the scale.
const WRONG_GRID: f64 = 0.08;
/// A number of crosses explains a scale if the scale with that number differs from 1 by at most this.
const GRID_SHARE: f64 = 0.02;
/// Readings that scatter by this many times as much as `--reading` states do not fit two lens distances.
const NOTABLE_SCATTER: f64 = 3.0;
/// Lens distances are worth a notice if they are known only to this share or worse.
const NOTABLE_UNCERTAINTY: f64 = 0.05;
/// Lens distances are worth a notice if their plates are closer together than this, mm.
const CLOSE_PLATES: f64 = 10.0;
/// A lens axis that is further from the middle of the field than this share of its longer side is stated.
const NOTABLE_OFFSET: f64 = 0.05;

#[derive(Debug, Args)]
pub(super) struct CalibrateArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Finds the lens distances and the axis from crosses that were marked on a plate at two or more heights.
    Lens(LensArguments),
}

#[derive(Debug, Args)]
struct LensArguments {
    /// The station's settings.
    station: PathBuf,
    /// Writes the drawings to mark, and empty tables for the measurements, into this folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["measured", "distance", "write", "json", "picture", "table"])]
    draw: Option<PathBuf>,
    /// Heights of the plate above the calibrated plane, mm.
    #[arg(long, value_name = "Z,Z", value_delimiter = ',', default_value = "0,30", allow_hyphen_values = true, value_parser = parse_height)]
    heights: Vec<f64>,
    /// Crosses along each side of the grid, 2 to 9.
    #[arg(long, value_name = "COUNT", default_value_t = 3, allow_hyphen_values = true, value_parser = clap::value_parser!(u8).range(2..=9))]
    crosses: u8,
    /// A filled-in table, of positions or of distances; may be repeated.
    #[arg(long, value_name = "FILE.csv")]
    measured: Vec<PathBuf>,
    /// A distance that was measured between two crosses: height of the plate, names of the crosses, mm, as in "30 A1 C1 143.2"; may be repeated.
    #[arg(long, value_name = "Z FROM TO MM", allow_hyphen_values = true)]
    distance: Vec<String>,
    /// All plates were held against the same stops, and positions were measured from the same edges: finds the lens axis, too.
    #[arg(long)]
    stops: bool,
    /// Standard deviation of one measurement, mm: 0.1 for a ruler, 0.02 for a caliper. Used while the measurements are too few to show it.
    #[arg(long, value_name = "MM", default_value_t = 0.1, allow_hyphen_values = true, value_parser = parse_reading)]
    reading: f64,
    /// Draws the residual of every cross.
    #[arg(long, value_name = "FILE.svg")]
    picture: Option<PathBuf>,
    /// Writes a lens table for `[optics] table`, for a lens that two distances do not describe; needs positions.
    #[arg(long, value_name = "FILE.csv")]
    table: Option<PathBuf>,
    /// Enters the result into the station's settings; comments are kept.
    #[arg(long)]
    write: bool,
    /// Prints the result as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    set: SetArguments,
}

pub(super) fn parse_reading(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (0.001..=5.0).contains(number));
    number.ok_or_else(|| "give a length from 0.001 to 5 mm, as in 0.05".into())
}

fn parse_height(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|height: &f64| height.abs() <= 1000.0);
    number.ok_or_else(|| "give heights in mm, as in 0,30".into())
}

impl CalibrateArguments {
    /// Whether JSON is to be printed.
    pub(super) fn json(&self) -> bool {
        let What::Lens(arguments) = &self.what;
        arguments.json
    }
}

/// The result of `calibrate lens`.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct LensDocument {
    schema: &'static str,
    /// Name and version of the program.
    program: String,
    /// The station's name.
    station: String,
    /// Whether the lens is telecentric as far as the measurements show.
    telecentric: bool,
    /// Distance from the calibrated plane to where the beams seem to meet, for x and y; absent for a telecentric lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    lens_distances_mm: Option<[Measured; 2]>,
    /// Where the lens axis meets the field, x and y; absent if the measurements do not show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_mm: Option<[Measured; 2]>,
    /// By how much all beams of a telecentric lens are tilted, to x and y, deg; absent if the measurements show no tilt.
    #[serde(skip_serializing_if = "Option::is_none")]
    beam_tilt_deg: Option<[Measured; 2]>,
    /// Size marked on the calibrated plane divided by size drawn, for x and y.
    scale: [Measured; 2],
    /// Standard deviation of one measurement, mm.
    reading_mm: f64,
    /// Number of measured values beyond those that are needed.
    spare: usize,
    /// How well the lens table describes the beams; absent without `--table`.
    #[serde(skip_serializing_if = "Option::is_none")]
    lens_table: Option<LensTableReport>,
    /// The plates on which positions were measured.
    plates: Vec<Plate>,
    /// The measured values.
    values: Vec<MeasuredValue>,
    /// The settings, as lines of a station's file.
    settings: Vec<String>,
    /// What was noticed.
    notices: Vec<Notice>,
}

/// A measured number with its standard deviation.
#[derive(Debug, Clone, Copy, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Measured {
    /// The number.
    pub(super) value: f64,
    /// Its standard deviation.
    pub(super) deviation: f64,
}

impl From<Uncertain> for Measured {
    fn from(number: Uncertain) -> Self {
        Self { value: number.value, deviation: number.deviation }
    }
}

/// A plate.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct Plate {
    /// Its height above the calibrated plane, mm.
    height_mm: f64,
    /// By how much it was turned, deg counter-clockwise.
    turned_deg: f64,
}

/// A measured value and how far it is from the fit.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MeasuredValue {
    /// The cross, such as `B2`, or two crosses, such as `A1-C1`.
    name: String,
    /// The height of the plate, mm.
    height_mm: f64,
    /// Measured minus fitted, mm: x and y in the directions of the field, or the distance.
    residual_mm: Vec<f64>,
    /// Whether a value was left out because it contradicts the others.
    left_out: bool,
}

/// The readings with the names of what was measured.
#[derive(Default)]
struct Named {
    readings: LensReadings,
    crosses: Vec<String>,
    distances: Vec<String>,
    /// Whether a distance was typed with the names of its crosses.
    is_typed: bool,
}

pub(super) fn run(arguments: &CalibrateArguments) -> Outcome {
    let What::Lens(arguments) = &arguments.what;
    let station = Station::load_with(&arguments.station, &arguments.set.of_station()?)?;
    let field = station.settings.field.ok_or_else(|| {
        Failure::usage("The station has no field.", "Give its size under [field] in the station's settings.")
    })?;
    let grid = crosses(&field.extents(), arguments.crosses.into());
    if let Some(folder) = &arguments.draw {
        return draw(arguments, &station, &field.extents(), &grid, folder);
    }
    if arguments.measured.is_empty() && arguments.distance.is_empty() {
        let file = shell::path(&arguments.station);
        return Err(Failure::usage(
            "No measurements are given.",
            format!(
                "Run `{}` for the drawing to mark, then give the filled-in table with `--measured`.",
                shell::command(&["calibrate", "lens", &file, "--draw", "lens-test"])
            ),
        ));
    }
    let written: Vec<(&str, &Path)> = [("--picture", &arguments.picture), ("--table", &arguments.table)]
        .into_iter()
        .filter_map(|(option, file)| Some((option, file.as_deref()?)))
        .collect();
    let read: Vec<&Path> =
        arguments.measured.iter().chain([&arguments.station]).map(PathBuf::as_path).collect();
    apart(&read, &written)?;
    let mut named = Named::default();
    (named.readings.same_stops, named.readings.reading) = (arguments.stops, arguments.reading);
    for file in &arguments.measured {
        named
            .add_table(&read_file(file)?)
            .map_err(|error| Failure::rejected(error.reason().in_file(file.display().to_string())))?;
    }
    for typed in &arguments.distance {
        named.add_distance(typed, &grid)?;
    }
    let fitted = LensCalibration::fit(&named.readings);
    let fitted = match arguments.table.is_some() {
        true => of_any_lens(&station, &named, fitted),
        false => fitted,
    };
    let found = fitted.map_err(|error| Failure::rejected(reason(&error, &named)))?;
    scale_is_possible(&found, &named, arguments.crosses)?;
    stops_are_shared(&found, &field.extents())?;
    if let Some(distance) = found.not_excluded().filter(|_| arguments.table.is_none()) {
        return Err(Failure::rejected(lens_not_excluded(&named, distance)));
    }
    finish(arguments, &station, &field.extents(), &named, &found)
}

/// The fit for a lens table, which contains what two distances do not describe. Values that do not fit two distances are left out
/// only if they do not fit the table either.
fn of_any_lens(
    station: &Station,
    named: &Named,
    fitted: Result<LensCalibration, CalibrationError>,
) -> Result<LensCalibration, CalibrationError> {
    match &fitted {
        Ok(found) if found.left_out.is_empty() => return fitted,
        Ok(_) | Err(CalibrationError::Contradictory { .. }) => {}
        Err(_) => return fitted,
    }
    let all = LensReadings { any_lens: true, ..named.readings.clone() };
    let whole = LensCalibration::fit(&all)?;
    let fits = lens_table(station, named, &whole)
        .is_ok_and(|table| read_lens_table(table.as_bytes(), Path::new("")).is_ok());
    if fits { Ok(whole) } else { fitted }
}

/// A telecentric lens that the measurements show no better than one that is not.
fn lens_not_excluded(named: &Named, distance: f64) -> Reason {
    let what = format!(
        "The measurements do not show whether the lens is telecentric: one with lens distances of {distance:.0} mm fits them as well{}.",
        named.apart()
    );
    Reason::new(
        "lens-not-determined",
        what,
        "Mark and measure crosses far apart, on plates at least 30 mm apart; `--reading` states how well you measure.",
    )
    .with_number("lens distance", distance, "mm", None)
}

/// Refuses a scale that only another unit, another grid or a misreading explains.
fn scale_is_possible(found: &LensCalibration, named: &Named, crosses: u8) -> Outcome {
    let unit = |scale: &Uncertain| unit_of_scale(scale.value, false).map(|unit| (scale.value, unit));
    if let Some((scale, unit)) = found.scale.iter().find_map(unit) {
        return Err(Failure::rejected(other_unit("On the calibrated plane", scale, unit)));
    }
    let off = |scale: &&Uncertain| (scale.value - 1.0).abs();
    let Some(worst) = found.scale.iter().max_by(|one, other| off(one).total_cmp(&off(other))) else {
        return Ok(());
    };
    // The names of crosses are those of the grid, while tables contain the places.
    let is_typed = named.readings.crosses.is_empty() && named.is_typed;
    let grid = (2..=9u8).filter(|count| is_typed && *count != crosses).find(|count| {
        let scale = f64::from(crosses - 1) / f64::from(*count - 1);
        found.scale.iter().all(|found| (found.value / scale - 1.0).abs() < GRID_SHARE)
    });
    let limit = if grid.is_some() { WRONG_GRID } else { WRONG_SCALE };
    if off(&worst) <= limit {
        return Ok(());
    }
    let what = format!(
        "On the calibrated plane, marks are measured {:.4} times as long as drawn, which is not a matter of calibration",
        worst.value
    );
    let (what, remedy) = match grid {
        Some(count) => (
            format!("{what}: the names are probably those of a drawing with {count} crosses along each side, not {crosses}."),
            format!("Give the number of crosses with which the drawing was made, `--crosses {count}`."),
        ),
        None => (
            format!("{what}."),
            "Check that the drawing that was marked is the one of this station and of `--crosses`, and the readings. If marks are \
             really of this size, calibrate the field in the marking software first."
                .to_owned(),
        ),
    };
    Err(Failure::rejected(Reason::new("field-scale", what, remedy).with_number(
        "scale",
        worst.value,
        "",
        Some(1.0),
    )))
}

fn other_unit(place: &str, scale: f64, unit: &str) -> Reason {
    let what =
        format!("{place}, marks are measured {scale:.4} times as long as drawn: the readings are {unit}.");
    Reason::new("measurements-unit", what, "Give all readings in mm, with the decimal sign at its place.")
        .with_number("scale", scale, "", None)
}

/// Refuses an axis that is not in the field: a lens is over its field, so that the plates were not held against the same stops.
fn stops_are_shared(found: &LensCalibration, field: &Extents) -> Outcome {
    let Some(axis) = found.axis else { return Ok(()) };
    let is_outside = |at: usize| {
        let Uncertain { value, deviation } = axis[at];
        (value - field.center()[at]).abs() > field.size()[at] / 2.0 + SURE * deviation
    };
    if !(0..2).any(is_outside) {
        return Ok(());
    }
    let [x, y] = axis.map(|axis| axis.value);
    let what =
        format!("With the same stops, the lens axis would be at ({x:.1}, {y:.1}) mm, outside the field");
    Err(Failure::rejected(stops_not_shared(what)))
}

fn stops_not_shared(what: impl std::fmt::Display) -> Reason {
    Reason::new(
        "stops-not-shared",
        format!("{what}."),
        "Hold all plates against the same two stops and measure positions from the same edges, on plates at two heights; or leave out \
         `--stops`: the lens distances follow without it, and the axis stays where the settings place it.",
    )
}

/// Writes the drawings and the empty tables.
fn draw(
    arguments: &LensArguments,
    station: &Station,
    field: &Extents,
    grid: &[Cross],
    folder: &Path,
) -> Outcome {
    let mut heights = arguments.heights.clone();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    if heights.len() < 2 {
        return Err(Failure::usage(
            "A lens is measured on plates at two or more heights.",
            "Give different heights, as in `--heights 0,30`.",
        ));
    }
    fs::create_dir_all(folder).map_err(|error| Failure::environment(&error))?;
    let tables = [
        ("lens-positions.csv", test_drawing::positions_table(grid, &heights)),
        ("lens-distances.csv", test_drawing::distances_table(grid, &heights, arguments.crosses.into())),
    ];
    for (name, table) in &tables {
        let path = folder.join(name);
        // A table with measurements must not be lost; an empty one may be written again.
        if path.exists() && read_file(&path)? != table.as_bytes() {
            return Err(Failure::usage(
                format!("{} exists and may contain measurements.", shown(&path)),
                "Name another folder, or remove the file.",
            ));
        }
    }
    for z in &heights {
        let drawing = test_drawing::drawing(field, grid, *z);
        let path = folder.join(format!("lens-z{z}.dxf"));
        write_file(&path, &pattern::write(&drawing, profile(&station.settings)))?;
        print(&format!("written  {}\n", shown(&path)));
    }
    for (name, table) in &tables {
        write_file(&folder.join(name), table.as_bytes())?;
        print(&format!("written  {}\n", shown(&folder.join(name))));
    }
    let file = shell::path(&arguments.station);
    let table = folder.join("lens-positions.csv");
    print(&format!(
        "\nMark each drawing on a plate whose top is at its height above the calibrated plane; do not move the head. Measure the \
         crosses, fill in one of the tables (a cell may stay empty), then\n  {}\n",
        shell::command(&["calibrate", "lens", &file, "--measured", &shell::path(&table)])
    ));
    Ok(())
}

impl Named {
    fn add_table(&mut self, bytes: &[u8]) -> Result<(), MeasurementsError> {
        let table = Measurements::read(bytes)?;
        for row in 0..table.len() {
            let z = table.required(row, "height_mm")?;
            let point =
                |x: &str, y: &str| Ok(FieldPoint::new(table.required(row, x)?, table.required(row, y)?));
            if table.has("measured_mm") {
                let ends = [point("from_x_mm", "from_y_mm")?, point("to_x_mm", "to_y_mm")?];
                let Some(measured) = table.number(row, "measured_mm")? else { continue };
                let names = [table.text(row, "from")?, table.text(row, "to")?];
                self.distances.push(on_one_line(&names.join("-")));
                self.readings.distances.push(DistanceReading { ends, z, measured });
            } else {
                let aim = point("x_mm", "y_mm")?;
                let measured = [table.number(row, "measured_x_mm")?, table.number(row, "measured_y_mm")?];
                if measured.iter().all(Option::is_none) {
                    continue;
                }
                self.crosses.push(on_one_line(table.text(row, "cross")?));
                self.readings.crosses.push(CrossReading { aim, z, measured });
            }
        }
        Ok(())
    }

    fn add_distance(&mut self, typed: &str, grid: &[Cross]) -> Outcome {
        let wrong = |what: String| {
            Failure::usage(what, "Give height, two crosses and mm, as in `--distance \"30 A1 C1 143.2\"`.")
        };
        let words: Vec<&str> = typed.split_whitespace().collect();
        let [z, from, to, measured] = words[..] else {
            return Err(wrong(format!("`--distance {typed}` does not have four parts.")));
        };
        let number =
            |text: &str| text.replace(',', ".").parse::<f64>().ok().filter(|number| number.abs() <= 10_000.0);
        let (Some(z), Some(measured)) = (number(z), number(measured)) else {
            return Err(wrong(format!("`--distance {typed}` contains a number that cannot be read.")));
        };
        let cross = |name: &str| {
            let found = grid.iter().find(|cross| cross.name.eq_ignore_ascii_case(name));
            found.map(|cross| cross.at).ok_or_else(|| wrong(format!("The grid has no cross `{name}`.")))
        };
        self.readings.distances.push(DistanceReading { ends: [cross(from)?, cross(to)?], z, measured });
        self.distances.push(format!("{from}-{to}").to_ascii_uppercase());
        self.is_typed = true;
        Ok(())
    }

    /// Lowest and highest plate, mm.
    fn heights(&self) -> [f64; 2] {
        let crosses = self.readings.crosses.iter().map(|cross| cross.z);
        let heights = crosses.chain(self.readings.distances.iter().map(|distance| distance.z));
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)])
    }

    /// How far the plates are apart, if that is little, as the end of a sentence.
    fn apart(&self) -> String {
        let [low, high] = self.heights();
        if high - low < CLOSE_PLATES {
            format!(", as the plates are only {} mm apart", shown_height(high - low))
        } else {
            String::new()
        }
    }

    /// A plate with a few crosses beside one with many: their height may be mistyped. As a sentence.
    fn few_on_a_plate(&self) -> Option<String> {
        let mut plates: Vec<(f64, Vec<&str>)> = Vec::new();
        for (cross, name) in self.readings.crosses.iter().zip(&self.crosses) {
            match plates.iter_mut().find(|(z, _)| (z - cross.z).abs() < 0.05) {
                Some((_, names)) => names.push(name),
                None => plates.push((cross.z, vec![name])),
            }
        }
        let most = plates.iter().map(|(_, names)| names.len()).max().unwrap_or(0);
        let (z, names) = plates.iter().min_by_key(|(_, names)| names.len())?;
        let list = names.join(", ");
        (4 * names.len() <= most).then(|| match names.len() {
            1 => format!(
                "At a height of {z} mm there is only the cross {list}: its height is probably mistyped."
            ),
            _ => format!(
                "At a height of {z} mm there are only the crosses {list}: their height is probably mistyped."
            ),
        })
    }

    /// A value in words, such as `x of cross B2 on the plate at 30 mm`.
    fn place(&self, place: ReadingPlace) -> String {
        match place {
            ReadingPlace::Cross(index, axis) => {
                let z = self.readings.crosses[index].z;
                format!("{} of cross {} on the plate at {z} mm", ["x", "y"][axis], self.crosses[index])
            }
            ReadingPlace::Distance(index) => {
                let z = self.readings.distances[index].z;
                format!("the distance {} on the plate at {z} mm", self.distances[index])
            }
        }
    }

    fn contradiction(&self, value: &LeftOut) -> String {
        let LeftOut { place, difference, predicted } = *value;
        format!(
            "{}: measured {:.2} mm, but {predicted:.2} mm follows from the others, a difference of {difference:+.2} mm",
            self.place(place),
            predicted + difference
        )
    }
}

/// A length without digits that only arithmetic made, mm.
fn shown_height(length: f64) -> f64 {
    (length * 1000.0).round() / 1000.0
}

fn reason(error: &CalibrationError, named: &Named) -> Reason {
    let undetermined = |what: String, remedy: &str| Reason::new("lens-not-determined", what, remedy);
    match *error {
        CalibrationError::NothingMeasured => undetermined(
            "Nothing is measured: no row of the table has a measured value.".into(),
            "Mark the crosses, measure them on at least two plates, and fill in the columns for the measured values.",
        ),
        CalibrationError::OneHeight => undetermined(
            format!("{error}."),
            "Mark and measure the crosses on a second plate at least 10 mm higher; the column is height_mm.",
        ),
        CalibrationError::TooMany { readings, .. } => undetermined(
            format!("{error}."),
            "Leave out rows, and check that the column height_mm has one height for each plate.",
        )
        .with_number("readings", readings as f64, "", Some(500.0)),
        CalibrationError::NotDetermined { .. } | CalibrationError::Contradictory { .. }
            if named.few_on_a_plate().is_some() =>
        {
            undetermined(
                format!("{error}. {}", named.few_on_a_plate().unwrap_or_default()),
                "Correct the column height_mm, or measure at least three crosses on each plate that are not on one line.",
            )
        }
        CalibrationError::NotDetermined { count } => undetermined(
            format!("{error}."),
            "Fill in more cells: on each plate at least three crosses that are not on one line, or distances along x and along y.",
        )
        .with_number("measured values", count as f64, "", None),
        CalibrationError::Swapped { .. } => Reason::new(
            "measurements-swapped",
            format!("{error}."),
            "Exchange the columns measured_x_mm and measured_y_mm of this plate.",
        ),
        CalibrationError::WrongSign { axis, .. } => Reason::new(
            "measurements-swapped",
            format!("{error}: measured {axis} becomes smaller where {axis} becomes larger."),
            "Count x to the right and y upwards, as in the field, from any zero.",
        ),
        CalibrationError::Diverging { scale, .. } if unit_of_scale(scale, false).is_some() => {
            other_unit("On the calibrated plane", scale, unit_of_scale(scale, false).unwrap_or_default())
        }
        CalibrationError::Steep { z, size, .. } if unit_of_scale(size, true).is_some() => {
            let place = format!("On the plate at {z} mm");
            other_unit(&place, size, unit_of_scale(size, true).unwrap_or_default())
        }
        CalibrationError::Steep { degrees, .. } => undetermined(
            format!("{error}."),
            "Check the column height_mm: the heights of the plates above the calibrated plane, in mm. With 3 instead of 30, a lens \
             seems ten times as near.",
        )
        .with_number("tilt of the beam", degrees, "deg", None),
        CalibrationError::Diverging { growth, .. } => undetermined(
            format!("{error}; towards the lens, marks become smaller."),
            "Check the column height_mm: it is positive towards the lens.",
        )
        .with_number("growth for each mm of height", growth * 100.0, "%", Some(0.0)),
        CalibrationError::AboveLens { z, distance } => undetermined(
            format!("{error}."),
            "Check the column height_mm: it is in mm above the calibrated plane.",
        )
        .with_number("height", z, "mm", Some(distance)),
        CalibrationError::StopsOfOnePlate { .. }
        | CalibrationError::StopsTurned { .. }
        | CalibrationError::StopsShifted { .. } => stops_not_shared(error),
        CalibrationError::Contradictory { deviation, worst } => Reason::new(
            "measurement-contradicts",
            format!("{error}. The worst is {}.", named.contradiction(&worst)),
            "Check the heights, the names of the crosses and this value. If they are right, two distances do not describe this lens: \
             measure five crosses along each side (`--draw DIR --crosses 5`), and write a lens table with `--table`.",
        )
        .with_number("standard deviation", deviation, "mm", Some(10.0 * named.readings.reading)),
        _ => undetermined(format!("{error}."), "Measure more crosses, far apart, on both plates."),
    }
}

fn finish(
    arguments: &LensArguments,
    station: &Station,
    field: &Extents,
    named: &Named,
    found: &LensCalibration,
) -> Outcome {
    let changes = changes(arguments, station, found)?;
    let table = arguments.table.as_ref().map(|file| -> Result<_, Failure> {
        let table = lens_table(station, named, found)?;
        let lens = read_lens_table(table.as_bytes(), file)
            .map_err(|bad| Failure::rejected(Reason::new("lens-not-determined", bad.what, bad.remedy)))?;
        Ok((file, table, LensTableReport::from(lens.residuals())))
    });
    let table = table.transpose()?;
    let known = table.as_ref().map(|(_, _, known)| *known);
    let document = document(station, field, named, found, &changes, known);
    if let Some(file) = &arguments.picture {
        write_file(file, picture(station, field, named, found).as_bytes())?;
    }
    if let Some((file, table, _)) = &table {
        write_file(file, table.as_bytes())?;
    }
    if arguments.write {
        station_edit::write(&arguments.station, "optics", &changes, |text| {
            Station::parse(&arguments.station, text).map(|_| ())
        })?;
    }
    if arguments.json {
        let json =
            serde_json::to_string_pretty(&document).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(json + "\n"));
    } else {
        print(&text(arguments, &document));
    }
    Ok(())
}

/// Lengths for settings: to 0.01 mm.
fn rounded(length: f64) -> f64 {
    (length * 100.0).round() / 100.0 + 0.0
}

/// The settings that describe the lens.
fn changes(
    arguments: &LensArguments,
    station: &Station,
    found: &LensCalibration,
) -> Result<Vec<Change>, Failure> {
    let nothing = |key: &'static str| (key, NewValue::Nothing);
    if let Some(table) = &arguments.table {
        let name = station_edit::beside(&arguments.station, table)?;
        let others = ["kind", "lens_distance_x_mm", "lens_distance_y_mm", "axis_mm"].map(nothing);
        return Ok([("table", NewValue::Text(name))].into_iter().chain(others).collect());
    }
    let Some([x, y]) = found.distances() else {
        let others = ["lens_distance_x_mm", "lens_distance_y_mm", "axis_mm", "table"].map(nothing);
        return Ok([("kind", NewValue::Text("telecentric".into()))].into_iter().chain(others).collect());
    };
    let mut changes = vec![
        ("kind", NewValue::Text("perspective".into())),
        ("lens_distance_x_mm", NewValue::Number(rounded(x.value))),
        ("lens_distance_y_mm", NewValue::Number(rounded(y.value))),
        nothing("table"),
    ];
    // An axis that was not measured stays where the settings place it.
    if let Some(axis) = found.axis {
        changes.push(("axis_mm", NewValue::Pair(axis.map(|axis| rounded(axis.value)))));
    } else if station.lens_table.is_some() {
        changes.push(nothing("axis_mm"));
    }
    Ok(changes)
}

fn document(
    station: &Station,
    field: &Extents,
    named: &Named,
    found: &LensCalibration,
    changes: &[Change],
    lens_table: Option<LensTableReport>,
) -> LensDocument {
    let left_out = |is: &dyn Fn(ReadingPlace) -> bool| found.left_out.iter().any(|value| is(value.place));
    let crosses = named.readings.crosses.iter().enumerate().map(|(index, cross)| MeasuredValue {
        name: named.crosses[index].clone(),
        height_mm: cross.z,
        residual_mm: found.residuals[index].iter().copied().filter(|value| value.is_finite()).collect(),
        left_out: left_out(&|place| matches!(place, ReadingPlace::Cross(of, _) if of == index)),
    });
    let distances = named.readings.distances.iter().enumerate().map(|(index, distance)| MeasuredValue {
        name: named.distances[index].clone(),
        height_mm: distance.z,
        residual_mm: vec![found.distance_residuals[index]],
        left_out: left_out(&|place| place == ReadingPlace::Distance(index)),
    });
    LensDocument {
        schema: SCHEMA,
        program: program(),
        station: station.name.clone(),
        telecentric: found.is_telecentric(),
        lens_distances_mm: found.distances().map(|distances| distances.map(Measured::from)),
        axis_mm: found.axis.map(|axis| axis.map(Measured::from)),
        beam_tilt_deg: found.tilt.map(|tilt| {
            tilt.map(|Uncertain { value, deviation }| Measured {
                value: value.atan().to_degrees(),
                deviation: deviation.to_degrees(),
            })
        }),
        scale: found.scale.map(Measured::from),
        reading_mm: found.reading,
        spare: found.spare,
        lens_table,
        plates: found
            .plates
            .iter()
            .map(|plate| Plate { height_mm: plate.z, turned_deg: plate.rotation.to_degrees() })
            .collect(),
        values: crosses.chain(distances).collect(),
        settings: changes.iter().filter_map(|(key, value)| value.line(key)).collect(),
        notices: notices(field, named, found, lens_table),
    }
}

fn notices(
    field: &Extents,
    named: &Named,
    found: &LensCalibration,
    lens_table: Option<LensTableReport>,
) -> Vec<Notice> {
    let contradicts = |value: &LeftOut| {
        let message = format!("{}; it was left out", named.contradiction(value));
        Notice::warning("measurement-contradicts", message)
    };
    let mut notices: Vec<Notice> = found.left_out.iter().map(contradicts).collect();
    for (axis, scale) in ["x", "y"].iter().zip(found.scale) {
        let off = scale.value - 1.0;
        if off.abs() > NOTABLE_SCALE.max(SURE * scale.deviation) {
            let advice = match lens_table {
                // Corrected twice, marks would be wrong by as much in the other direction.
                Some(_) => {
                    "the lens table compensates for it: leave the scale in the marking software's calibration as it is, and check the \
                     ruler. After a change of that calibration, mark and measure again"
                }
                None => "correct the scale in the marking software's calibration, or check the ruler",
            };
            let message = format!(
                "on the calibrated plane, {axis} is marked {:.4} times as long as drawn; {advice}",
                scale.value
            );
            notices.push(Notice::warning("field-scale", message));
        }
    }
    notices.extend(lens_table.and_then(|table| table.notice()));
    if lens_table.is_none() {
        notices.extend(does_not_fit(named, found));
        notices.extend(lens_uncertain(named, found));
    }
    notices.extend(beams_tilted(named, found, lens_table.is_some()));
    if found.axis.is_none() && !found.is_telecentric() {
        let message = "the axis of the lens was not measured; the settings keep it in the middle of the field, or at `axis_mm`. To \
                       measure it, hold all plates against the same two stops, measure positions from the same edges, and give \
                       `--stops`";
        notices.push(Notice::note("axis-not-measured", message));
    }
    notices.extend(axis_off_middle(field, found));
    notices
}

/// Two distances are a model, which short lenses with a wide field do not follow.
fn does_not_fit(named: &Named, found: &LensCalibration) -> Option<Notice> {
    let stated = named.readings.reading;
    if found.spare == 0 || found.reading <= NOTABLE_SCATTER * stated {
        return None;
    }
    let of_cross = found
        .residuals
        .iter()
        .map(|residual| residual.norm())
        .zip(&named.readings.crosses)
        .zip(&named.crosses);
    let of_cross = of_cross.map(|((size, cross), name)| (size, cross.z, name));
    let of_distance = found.distance_residuals.iter().map(|size| size.abs()).zip(&named.readings.distances);
    let of_distance =
        of_distance.zip(&named.distances).map(|((size, distance), name)| (size, distance.z, name));
    let sizes = of_cross.chain(of_distance).filter(|(size, ..)| size.is_finite());
    let worst = sizes.max_by(|one, other| one.0.total_cmp(&other.0));
    let worst = worst.map_or(String::new(), |(size, z, name)| {
        format!(", most {name} on the plate at {z} mm, by {size:.2} mm")
    });
    let message = format!(
        "the measurements differ from these lens distances by {:.3} mm, {:.1} times as much as `--reading` states{worst}: a value is \
         wrong, or two distances do not describe this lens. If the values are right, measure five crosses along each side \
         (`--draw DIR --crosses 5`), and write a lens table with `--table`",
        found.reading,
        found.reading / stated
    );
    Some(Notice::warning("lens-residual", message))
}

/// Lens distances from a small difference.
fn lens_uncertain(named: &Named, found: &LensCalibration) -> Option<Notice> {
    let distances = found.distances()?;
    let share = distances.iter().map(|distance| distance.deviation / distance.value).fold(0.0, f64::max);
    let apart = named.apart();
    (share > NOTABLE_UNCERTAINTY || !apart.is_empty()).then(|| {
        let message = format!(
            "the lens distances are known to {:.1} % only{apart}; use plates 30 mm apart or more, and crosses far apart",
            share * 100.0
        );
        Notice::warning("lens-uncertain", message)
    })
}

/// The beams of a telecentric lens are parallel, but the head may be inclined.
fn beams_tilted(named: &Named, found: &LensCalibration, with_table: bool) -> Option<Notice> {
    let tilt = found.tilt?.map(|tilt| tilt.value);
    let [low, high] = named.heights();
    let (shift, degrees) =
        (tilt.map(|tilt| tilt * (high - low)), Vector2::from(tilt).norm().atan().to_degrees());
    let advice = match with_table {
        true => "the lens table contains it",
        false => {
            "`kind = \"telecentric\"` does not contain it: mount the head upright and measure again, or write a lens table with `--table`, \
             which contains it"
        }
    };
    let message = format!(
        "all beams are tilted by {degrees:.1} deg: marks on the plate at {high} mm are ({:+.2}, {:+.2}) mm from those on the plate at {low} \
         mm, unless that plate was off its stops; {advice}",
        shift[0], shift[1]
    );
    Some(Notice::warning("beams-tilted", message))
}

/// A lens is over the middle of its field, and a plate that is a little off its stops moves the axis by many times as much.
fn axis_off_middle(field: &Extents, found: &LensCalibration) -> Option<Notice> {
    let axis = found.axis?;
    let middle = field.center();
    let off = Vector2::new(axis[0].value, axis[1].value) - middle;
    let known = SURE * axis[0].deviation.hypot(axis[1].deviation);
    if off.norm() <= NOTABLE_OFFSET * field.size().max() + known {
        return None;
    }
    let heights = || found.plates.iter().map(|plate| plate.z);
    let apart = heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
    let slip = (off.component_mul(&Vector2::from(found.convergence.map(|side| side.value))) * apart).norm();
    let cause = match found.plates.len() {
        2 => format!("a plate that was {slip:.1} mm off its stops would explain it"),
        _ => format!("plates that moved by {slip:.1} mm between the lowest and the highest would explain it"),
    };
    let message = format!(
        "the lens axis is {:.1} mm from the middle of the field, ({:.1}, {:.1}) mm; {cause}. If the head is over the middle of the \
         field, measure again with all plates against the stops, or leave out `--stops`",
        off.norm(),
        middle.x,
        middle.y
    );
    Some(Notice::warning("axis-off-middle", message))
}

fn text(arguments: &LensArguments, document: &LensDocument) -> String {
    let mut text =
        format!("{}: lens from {} measured places\n", on_one_line(&document.station), document.values.len());
    let mut line = |label: &str, value: String| {
        let _ = writeln!(text, "  {label:<18}{value}");
    };
    match &document.lens_distances_mm {
        Some([x, y]) => {
            line("lens distance x", format!("{:.1} mm +- {:.1} mm", x.value, x.deviation));
            line("lens distance y", format!("{:.1} mm +- {:.1} mm", y.value, y.deviation));
        }
        None => line("lens", "telecentric, as far as the measurements show".into()),
    }
    if let Some([x, y]) = &document.axis_mm {
        line(
            "lens axis",
            format!(
                "x {:.1} mm +- {:.1} mm, y {:.1} mm +- {:.1} mm",
                x.value, x.deviation, y.value, y.deviation
            ),
        );
    }
    if let Some([x, y]) = &document.beam_tilt_deg {
        let [x, y] = [x, y].map(|tilt| format!("{:.2} deg +- {:.2} deg", tilt.value, tilt.deviation));
        line("beam tilt", format!("x {x}, y {y}"));
    }
    let [x, y] = &document.scale;
    line(
        "scale at z = 0",
        format!("x {:.4} +- {:.4}, y {:.4} +- {:.4}", x.value, x.deviation, y.value, y.deviation),
    );
    line(
        "one measurement",
        format!("+- {:.3} mm, {} more values than needed", document.reading_mm, document.spare),
    );
    if let Some(table) = &document.lens_table {
        line("lens table", table.summary());
    }
    for plate in &document.plates {
        line(&format!("plate at {} mm", plate.height_mm), format!("turned by {:.2} deg", plate.turned_deg));
    }
    text += "\n  cross     height mm   residual mm\n";
    for value in &document.values {
        let residual: Vec<String> = value.residual_mm.iter().map(|value| format!("{value:+7.3}")).collect();
        let mark = if value.left_out { "  left out" } else { "" };
        let _ = writeln!(text, "  {:<10}{:>9}   {}{mark}", value.name, value.height_mm, residual.join(" "));
    }
    station_edit::add_notices(&mut text, &document.notices);
    let done = arguments.write.then_some(arguments.station.as_path());
    station_edit::add_lines(&mut text, done, "optics", &document.settings);
    text
}

fn picture(station: &Station, field: &Extents, named: &Named, found: &LensCalibration) -> String {
    let arrows: Vec<picture::Arrow> = named
        .readings
        .crosses
        .iter()
        .enumerate()
        .map(|(index, cross)| picture::Arrow {
            name: named.crosses[index].clone(),
            z: cross.z,
            at: cross.aim.coords(),
            residual: found.residuals[index],
            is_left_out: found
                .left_out
                .iter()
                .any(|value| matches!(value.place, ReadingPlace::Cross(of, _) if of == index)),
        })
        .collect();
    let lens = found.distances().map_or("telecentric".to_owned(), |[x, y]| {
        format!("lens distances {:.1} and {:.1} mm", x.value, y.value)
    });
    let line = format!("{lens}; residuals of {:.3} mm (standard deviation)", found.reading);
    picture::svg(&format!("{} · lens test", station.name), &line, field, &arrows)
}

/// The measured positions without the turn and shift of each plate, as a lens table.
fn lens_table(station: &Station, named: &Named, found: &LensCalibration) -> Result<String, Failure> {
    if named.readings.crosses.is_empty() {
        return Err(Failure::usage(
            "A lens table needs measured positions, and only distances are given.",
            "Fill in lens-positions.csv.",
        ));
    }
    let head = station.settings.scan_head();
    let axis = found.axis.map_or(head.axis.coords(), |axis| Vector2::new(axis[0].value, axis[1].value));
    let mut table = LENS_TABLE_COLUMNS.join(";") + "\n";
    for (index, cross) in named.readings.crosses.iter().enumerate() {
        let is_left_out = |value: &LeftOut| matches!(value.place, ReadingPlace::Cross(of, _) if of == index);
        if found.left_out.iter().any(is_left_out) || cross.measured.iter().any(Option::is_none) {
            continue;
        }
        let shrink = Vector2::new(0, 1)
            .map(|side| found.scale[side].value * (1.0 - cross.z * found.convergence[side].value));
        let fitted = axis + (cross.aim.coords() - axis).component_mul(&shrink);
        let tilt = found.tilt.map_or(Vector2::zeros(), |tilt| Vector2::new(tilt[0].value, tilt[1].value));
        let seen = fitted + found.residuals[index] + tilt * cross.z;
        let _ = writeln!(table, "{};{};{};{:.4};{:.4}", cross.aim.x, cross.aim.y, cross.z, seen.x, seen.y);
    }
    Ok(table)
}
