//! The places that the 3-D view can show: letters for the largest values, numbers for notices.

use serde_json::{Value, json};

use super::content::Landmarks;
use crate::reason::Notice;

/// Largest number of places of all notices together.
const MAX_PLACES: usize = 300;

/// A label in the picture, with its places in the part frame, mm.
struct Spot {
    label: String,
    at: Vec<[f64; 3]>,
}

/// The labelled places of a report.
#[derive(Default)]
pub(super) struct Spots(Vec<Spot>);

/// A labelled place, for the button that shows it.
pub(super) struct SpotLabel {
    pub(super) index: usize,
    pub(super) label: String,
}

/// The labels of the largest values.
pub(super) struct ValueLabels {
    pub(super) stretch: Option<SpotLabel>,
    pub(super) incidence: Option<SpotLabel>,
    pub(super) residual: Option<SpotLabel>,
}

impl Spots {
    /// Labels the places of the largest values.
    pub(super) fn of_values(&mut self, landmarks: &Landmarks) -> ValueLabels {
        let mut label =
            |name: &str, at: Option<[f64; 3]>| self.add(name.to_owned(), at.into_iter().collect());
        ValueLabels {
            stretch: label("A", landmarks.stretch_at),
            incidence: label("B", landmarks.incidence_at),
            residual: label("C", landmarks.residual_at),
        }
    }

    /// Labels the places of a notice; `number` is its number among the notices with places.
    pub(super) fn of_notice(&mut self, number: usize, notice: &Notice) -> Option<SpotLabel> {
        let shown: usize = self.0.iter().map(|spot| spot.at.len()).sum();
        let room = MAX_PLACES.saturating_sub(shown);
        self.add(number.to_string(), notice.places_mm.iter().take(room).copied().collect())
    }

    fn add(&mut self, label: String, mut at: Vec<[f64; 3]>) -> Option<SpotLabel> {
        at.retain(|point| point.iter().all(|value| value.is_finite()));
        if at.is_empty() {
            return None;
        }
        self.0.push(Spot { label: label.clone(), at });
        Some(SpotLabel { index: self.0.len() - 1, label })
    }

    /// The places for the viewer, rounded to a thousandth of a millimetre.
    pub(super) fn to_json(&self) -> Value {
        let spot = |spot: &Spot| {
            let at: Vec<[f64; 3]> = spot.at.iter().copied().map(rounded).collect();
            json!({ "label": spot.label, "at": at })
        };
        self.0.iter().map(spot).collect()
    }

    /// Labels and places as text.
    pub(super) fn lines(&self) -> impl Iterator<Item = (String, String)> {
        self.0.iter().map(|spot| {
            let [x, y, z] = to_decimals(spot.at.first().copied().unwrap_or_default(), 2);
            let more = match spot.at.len() {
                0 | 1 => String::new(),
                count => format!(" and {} more", count - 1),
            };
            (spot.label.clone(), format!("({x:.2}, {y:.2}, {z:.2}) mm{more}"))
        })
    }
}

/// A point to a thousandth of a millimetre, without negative zeros.
pub(super) fn rounded(point: [f64; 3]) -> [f64; 3] {
    to_decimals(point, 3)
}

/// Numbers with `decimals` decimals, without negative zeros.
pub(super) fn to_decimals<const N: usize>(values: [f64; N], decimals: i32) -> [f64; N] {
    let scale = 10_f64.powi(decimals);
    values.map(|value| (value * scale).round() / scale + 0.0)
}
