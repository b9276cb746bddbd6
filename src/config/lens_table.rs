//! The table of a measured lens.

use std::path::Path;

use crate::formats::measurements::{Measurements, unit_of_scale};
use crate::geometry::optics::Lens;
use crate::geometry::optics::measured::{MOST_SIGHTINGS, MeasuredLens, MeasuredLensError, Sighting};
use crate::geometry::space::FieldPoint;

/// The columns of a table: where the beam was aimed, the height of the plate, and where it was seen.
pub const LENS_TABLE_COLUMNS: [&str; 5] = ["x_mm", "y_mm", "z_mm", "seen_x_mm", "seen_y_mm"];

/// What is wrong with a table, and what to do.
pub(crate) struct BadTable {
    pub(crate) what: String,
    pub(crate) remedy: String,
}

/// The lens of a table. Lines without both measured values are skipped.
pub(super) fn load(file: &Path) -> Result<Lens, BadTable> {
    let bytes = std::fs::read(file).map_err(|error| BadTable {
        what: format!("The lens table {}: it cannot be read: {error}.", file.display()),
        remedy: "Check the name; relative paths start at this file.".into(),
    })?;
    read(&bytes, file).map(Lens::Measured)
}

/// The lens of the bytes of a table, which is in `file`.
pub(crate) fn read(bytes: &[u8], file: &Path) -> Result<MeasuredLens, BadTable> {
    let bad = |what: String, remedy: String| BadTable {
        what: format!("The lens table {}: {what}", file.display()),
        remedy,
    };
    let unreadable = |error: crate::formats::measurements::MeasurementsError| {
        let reason = error.reason();
        let line = reason.place.line.map_or(String::new(), |line| format!("line {line}: "));
        bad(format!("{line}{error}."), reason.remedy)
    };
    let table = Measurements::read(bytes).map_err(unreadable)?;
    let (mut rows, mut lines, mut gaps) = (Vec::new(), Vec::new(), 0);
    for row in 0..table.len() {
        let seen = [3, 4].map(|column| table.number(row, LENS_TABLE_COLUMNS[column]));
        let [x, y] = seen;
        let (Some(x), Some(y)) = (x.map_err(unreadable)?, y.map_err(unreadable)?) else {
            gaps += 1;
            continue;
        };
        let given = [0, 1, 2].map(|column| table.required(row, LENS_TABLE_COLUMNS[column]));
        let [aim_x, aim_y, z] = given;
        let aim = FieldPoint::new(aim_x.map_err(unreadable)?, aim_y.map_err(unreadable)?);
        rows.push(Sighting { aim, z: z.map_err(unreadable)?, seen: nalgebra::Vector2::new(x, y) });
        lines.push(table.line(row));
    }
    if rows.len() > MOST_SIGHTINGS {
        return Err(bad(
            format!("it has {} rows.", rows.len()),
            format!("Leave at most {MOST_SIGHTINGS} rows."),
        ));
    }
    MeasuredLens::fit(&rows).map(|(lens, _)| lens).map_err(|error| {
        let (what, remedy) = match error {
            MeasuredLensError::TooFew { .. } => {
                (format!("{error}; {gaps} rows have empty cells."), "Fill in the empty cells, or measure more crosses.")
            }
            MeasuredLensError::OneHeight { .. } => {
                (format!("{error}."), "Add rows that were measured on a plate at another height.")
            }
            MeasuredLensError::OnLine => {
                (format!("{error}."), "Add rows for crosses beside the line.")
            }
            MeasuredLensError::Swapped => (format!("{error}."), "Exchange the columns seen_x_mm and seen_y_mm."),
            MeasuredLensError::WrongSign { axis } => (
                format!("{error}: seen {axis} becomes smaller where {axis} becomes larger."),
                "Count x to the right and y upwards, as in the field.",
            ),
            MeasuredLensError::Mistake { index, axis, difference, predicted } => (
                format!(
                    "line {}: seen_{axis}_mm is {difference:+.2} mm from what the other rows predict, {predicted:.2} mm.",
                    lines[index]
                ),
                "Measure this cross again, correct the value, or clear the cell.",
            ),
            MeasuredLensError::Scale { scale } => match unit_of_scale(scale, false) {
                Some(unit) => (format!("{error}: seen_x_mm and seen_y_mm are {unit}."), "Give all readings in mm."),
                None => (
                    format!("{error}."),
                    "Give all readings in mm, and in x_mm and y_mm the places in the drawing that was marked.",
                ),
            },
            MeasuredLensError::Diverging { .. } => (
                format!("{error}."),
                "Check the sign of z_mm, which is positive towards the lens; and check that x_mm and y_mm are the places in the drawing, \
                 and seen_x_mm and seen_y_mm those on the plate.",
            ),
            MeasuredLensError::Steep { .. } => (
                format!("{error}."),
                "Check the column z_mm: heights above the calibrated plane, in mm; and give all readings in mm.",
            ),
            _ => (format!("{error}."), "Check the column z_mm: heights above the calibrated plane, in mm."),
        };
        bad(what, remedy.to_owned())
    })
}
