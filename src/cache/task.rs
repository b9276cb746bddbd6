//! A part that another computer is to fit, as bytes.
//!
//! ```text
//! length of the head, 4 bytes ── head: settings, names and lengths of the files ── contents of the files
//! ```

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::config::{Converter, PartSettings, ViewSource};
use crate::files::is_plain;
use crate::formats::mesh::{LengthUnit, NormalsChoice, PartFile, UpAxis};
use crate::geometry::space::Facing;
use crate::geometry::surface::scan::Smoothing;

/// The gaps to bridge and the waves to remove that settings may name, mm.
const BRIDGE: RangeInclusive<f64> = 0.0..=100.0;
const LOW_PASS: RangeInclusive<f64> = 0.1..=1000.0;
/// The largest head, bytes.
const LARGEST_HEAD: usize = 1 << 20;

/// A part with everything that its fit depends on.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FitTask {
    /// The part's file, with those that it needs.
    pub part: PartFile,
    /// The settings of the fit.
    pub settings: PartSettings,
}

#[derive(Serialize, Deserialize)]
struct Head {
    /// The part, and then the files beside it, each with its length in bytes.
    files: Vec<(String, u64)>,
    facing: [f64; 3],
    roll: f64,
    /// Whether a marking frame in the part's file replaces the view.
    leaves_view_to_file: bool,
    unit: Option<LengthUnit>,
    up: Option<UpAxis>,
    normals: NormalsChoice,
    bridge: Option<f64>,
    /// `None` for automatic smoothing, 0 for none, or the wavelength of the low pass, mm.
    smoothing: Option<f64>,
}

impl FitTask {
    /// The greatest number of bytes.
    pub const LARGEST: usize = 64 << 20;

    /// A part and its settings as bytes; `None` if they are too large, or if the fit also depends on this computer or on a person:
    /// on a converter, on a marking frame of the settings, or on sizes in place of a file.
    #[must_use]
    pub fn to_bytes(part: &PartFile, settings: &PartSettings) -> Option<Vec<u8>> {
        let PartSettings {
            facing,
            roll,
            view_source,
            unit,
            up,
            normals,
            bridge,
            smoothing,
            converter,
            primitive,
        } = settings;
        let leaves_view_to_file = match view_source {
            ViewSource::Station => true,
            ViewSource::Sides | ViewSource::Rolled => false,
            ViewSource::Frame(_) | ViewSource::FrameOfFile(_) => return None,
        };
        if *converter != Converter::None || primitive.is_some() {
            return None;
        }
        let files: Vec<(&String, &Vec<u8>)> =
            std::iter::once((&part.name, &part.bytes)).chain(&part.siblings).collect();
        let head = Head {
            files: files.iter().map(|(name, bytes)| ((*name).clone(), bytes.len() as u64)).collect(),
            facing: facing.direction().into(),
            roll: *roll,
            leaves_view_to_file,
            unit: *unit,
            up: *up,
            normals: *normals,
            bridge: *bridge,
            smoothing: match smoothing {
                Smoothing::Auto => None,
                Smoothing::None => Some(0.0),
                Smoothing::LowPass { wavelength } => Some(*wavelength),
            },
        };
        let head = postcard::to_stdvec(&head).ok().filter(|head| head.len() <= LARGEST_HEAD)?;
        let size = files.iter().fold(4 + head.len(), |size, (_, bytes)| size.saturating_add(bytes.len()));
        if size > Self::LARGEST {
            return None;
        }
        let mut task = Vec::with_capacity(size);
        task.extend_from_slice(&u32::try_from(head.len()).ok()?.to_le_bytes());
        task.extend_from_slice(&head);
        files.iter().for_each(|(_, bytes)| task.extend_from_slice(bytes));
        Some(task)
    }

    /// The part and the settings in bytes of another computer.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn from_bytes(task: &[u8]) -> Result<Self, String> {
        let cut = || "it is truncated".to_owned();
        let (length, rest) = task.split_first_chunk::<4>().ok_or_else(cut)?;
        let length = usize::try_from(u32::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (head, mut rest) = rest.split_at_checked(length.min(LARGEST_HEAD)).ok_or_else(cut)?;
        let head: Head =
            postcard::from_bytes(head).map_err(|error| format!("its head is invalid: {error}"))?;
        let mut files = Vec::new();
        for (name, length) in head.files {
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            let (content, others) = rest.split_at_checked(length).ok_or_else(cut)?;
            if !is_plain(&name) {
                return Err("a name in it is not the name of a file".into());
            }
            files.push((name, content.to_vec()));
            rest = others;
        }
        if !rest.is_empty() {
            return Err("it is longer than its files".into());
        }
        let mut files = files.into_iter();
        let (name, bytes) = files.next().ok_or_else(|| "it has no part".to_owned())?;
        let is_smoothing = |length: &f64| *length == 0.0 || LOW_PASS.contains(length);
        let (true, true, true, Some(facing)) = (
            head.roll.is_finite(),
            head.bridge.iter().all(|bridge| BRIDGE.contains(bridge)),
            head.smoothing.iter().all(is_smoothing),
            Facing::of_unit(Vector3::from(head.facing)),
        ) else {
            return Err("a setting in it is out of range".into());
        };
        let settings = PartSettings {
            facing,
            roll: head.roll,
            view_source: if head.leaves_view_to_file { ViewSource::Station } else { ViewSource::Sides },
            unit: head.unit,
            up: head.up,
            normals: head.normals,
            bridge: head.bridge,
            smoothing: match head.smoothing {
                None => Smoothing::Auto,
                Some(0.0) => Smoothing::None,
                Some(wavelength) => Smoothing::LowPass { wavelength },
            },
            converter: Converter::None,
            primitive: None,
        };
        Ok(Self { part: PartFile { name, bytes, siblings: files.collect::<BTreeMap<_, _>>() }, settings })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::Primitive;

    fn part() -> PartFile {
        let siblings = BTreeMap::from([("a.bin".to_owned(), vec![7; 300]), ("b.bin".to_owned(), Vec::new())]);
        PartFile { name: "mug.gltf".into(), bytes: b"{}".to_vec(), siblings }
    }

    fn several_settings() -> Vec<PartSettings> {
        let usual = PartSettings::default();
        // Directions whose length is 1 only to within rounding stay as they are, bit for bit.
        let oblique = (1..40).map(|x| {
            let facing = Facing::towards(Vector3::new(f64::from(x), 2.0, 0.3)).unwrap();
            PartSettings { facing, roll: 0.1 * f64::from(x), view_source: ViewSource::Sides, ..usual.clone() }
        });
        let others = [
            PartSettings { unit: Some(LengthUnit::Inch), up: Some(UpAxis::Y), ..usual.clone() },
            PartSettings { normals: NormalsChoice::File, bridge: Some(0.1 + 0.2), ..usual.clone() },
            PartSettings { smoothing: Smoothing::None, ..usual.clone() },
            PartSettings { smoothing: Smoothing::LowPass { wavelength: 16.0 / 3.0 }, ..usual.clone() },
        ];
        oblique.chain(others).chain([usual.clone()]).collect()
    }

    #[test]
    fn a_task_arrives_as_it_was_sent() {
        for settings in several_settings() {
            let task = FitTask::to_bytes(&part(), &settings).unwrap();
            assert_eq!(FitTask::from_bytes(&task).unwrap(), FitTask { part: part(), settings });
        }
    }

    #[test]
    fn fits_that_depend_on_more_than_the_task_are_made_here() {
        let usual = PartSettings::default();
        let with_converter = PartSettings { converter: Converter::FreeCad, ..usual.clone() };
        let primitive = Primitive::new(80.0, 80.0, 100.0, Vector3::x());
        let with_sizes = PartSettings { primitive, ..usual.clone() };
        assert!(with_sizes.primitive.is_some());
        for settings in [with_converter, with_sizes] {
            assert_eq!(FitTask::to_bytes(&part(), &settings), None);
        }
        let large = PartFile::alone("large.stl", vec![0; FitTask::LARGEST]);
        assert_eq!(FitTask::to_bytes(&large, &usual), None);
    }

    #[test]
    fn a_task_with_any_cut_or_another_name_is_refused() {
        let task = FitTask::to_bytes(&part(), &PartSettings::default()).unwrap();
        for end in 0..task.len() {
            assert!(FitTask::from_bytes(&task[..end]).is_err(), "cut at {end}");
        }
        assert!(FitTask::from_bytes(&[&task[..], b"x"].concat()).is_err());
        let mut hostile = part();
        for name in ["../mug.gltf", "/etc/passwd", "a\\b.gltf", ""] {
            hostile.name = name.into();
            let task = FitTask::to_bytes(&hostile, &PartSettings::default()).unwrap();
            assert!(FitTask::from_bytes(&task).is_err(), "{name}");
        }
        assert!(FitTask::from_bytes(&[0xff; 64]).is_err());
    }
}
