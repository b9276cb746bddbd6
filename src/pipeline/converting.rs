//! STEP parts with a face that is not read and that the laser sees: converted, where the settings request it.

use super::PipelineError;
use crate::config::{Converter, PartSettings};
use crate::converter;
use crate::formats::Pace;
use crate::formats::mesh::{PartFile, PartReading};
use crate::geometry::surface::fit::FittedSurface;
use crate::reason::{Notice, Reason};

/// Names in a STEP file that a conversion loses, and that decide where the mark is.
const NAMES: [&str; 2] = ["'isomark'", "'mark'"];

/// What `read` makes of a part; if the part is rejected because of a face that is not read, and the settings request it, what it
/// makes of the converted part.
pub(super) fn read_or_convert(
    part: &PartFile,
    settings: &PartSettings,
    pace: Pace,
    mut read: impl FnMut(&PartFile) -> Result<(PartReading, FittedSurface), PipelineError>,
) -> Result<(PartReading, FittedSurface), PipelineError> {
    let rejected = match read(part) {
        Err(PipelineError::Rejected(reason)) if reason.code == "step-face-unread" => reason,
        other => return other,
    };
    if settings.converter == Converter::None {
        return Err(rejected.into());
    }
    if let Some(why) = obstacle(part, settings) {
        return Err(not_converted(rejected, &why).into());
    }
    if pace == Pace::Quick {
        return Err(PipelineError::TakesLong);
    }
    tracing::info!("{}: converting the faces with FreeCAD", part.name);
    let bytes = match converter::with_splines(&part.bytes) {
        Ok(bytes) => bytes,
        Err(error) => return Err(not_converted(rejected, &format!("{error}.")).into()),
    };
    let (mut reading, surface) = match read(&PartFile { bytes, ..part.clone() }) {
        Err(PipelineError::Rejected(again)) => {
            let why = format!("the part that FreeCAD wrote is also rejected: {}", again.what);
            return Err(not_converted(rejected, &why).into());
        }
        other => other?,
    };
    let message = format!(
        "FreeCAD converted all faces to B-splines, because one is not read: {} Compare the size of the part, and mark a test piece",
        rejected.what
    );
    reading.facts.notices.push(Notice::warning("step-converted", message));
    Ok((reading, surface))
}

/// Why a part must not be converted.
fn obstacle(part: &PartFile, settings: &PartSettings) -> Option<String> {
    let has = |name: &&str| part.bytes.windows(name.len()).any(|window| window == name.as_bytes());
    if let Some(name) = NAMES.iter().find(|name| has(name)) {
        return Some(format!("the file has the name {name}, which a conversion loses."));
    }
    settings.unit.map(|unit| {
        format!("`part.unit = \"{unit}\"` is for the numbers of the file, which a conversion changes.")
    })
}

/// The reason for a part that was not converted.
fn not_converted(reason: Reason, why: &str) -> Reason {
    let what = format!("{} It was not converted: {why}", reason.what);
    Reason { what, ..reason }
}
