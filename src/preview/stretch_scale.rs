//! The colours of the stretch: dark for a correct length, blue for too short, orange for too long.
//!
//! Blue and orange can be distinguished with every common type of colour blindness. In a grey print, the darkness alone
//! shows how correct a line is.

use std::sync::LazyLock;

/// Number of colours on each side of the correct length; there are 21 in all.
const STEPS: i32 = 10;
/// Round limits, in % times a power of ten.
const ROUND: [f64; 9] = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0];
/// Share of the drawn length that the scale must cover: a few segments with a large stretch must not determine the
/// scale.
const COVERED: f64 = 0.99;

/// From stretch to colour: symmetric about the correct length, with a round limit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StretchScale {
    /// Stretch at the ends of the scale, without unit (0.1 is 10 %).
    pub(super) limit: f64,
    /// Whether some stretch is beyond the limit and is shown in the end colours.
    pub(super) exceeded: bool,
}

/// One of the 21 colours, counted from the correct length: negative is shorter, positive is longer; `None` is unknown.
pub(super) type Shade = Option<i32>;

impl StretchScale {
    /// The smallest round scale that covers the given pairs of length (mm) and stretch.
    pub(super) fn covering(weighted: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut sizes: Vec<(f64, f64)> = weighted
            .filter(|(_, stretch)| stretch.is_finite())
            .map(|(length, s)| (s.abs(), length))
            .collect();
        sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f64 = sizes.iter().map(|(_, length)| length).sum();
        let mut passed = 0.0;
        let covered = sizes.iter().find(|(_, length)| {
            passed += length;
            passed >= COVERED * total
        });
        let largest = sizes.last().map_or(0.0, |(size, _)| *size);
        let limit = round_limit(covered.map_or(0.0, |(size, _)| *size));
        // If the scale covers almost everything, it is extended to cover all.
        let limit = if largest <= 1.3 * limit { round_limit(largest) } else { limit };
        Self { limit, exceeded: largest > limit }
    }

    /// The colour step of a stretch; unknown if it is not finite.
    pub(super) fn shade(&self, stretch: f64) -> Shade {
        stretch.is_finite().then(|| {
            let step = stretch / self.limit * f64::from(2 * STEPS + 1) / 2.0;
            step.clamp(f64::from(-STEPS), f64::from(STEPS)).round() as i32
        })
    }

    /// All colour steps, from the shortest to the longest.
    pub(super) fn steps() -> impl DoubleEndedIterator<Item = i32> {
        -STEPS..=STEPS
    }

    /// The steps in drawing order: the largest errors last, so that they are on top.
    pub(super) fn drawing_order() -> impl Iterator<Item = Shade> {
        let pairs = (1..=STEPS).flat_map(|step| [Some(-step), Some(step)]);
        [None, Some(0)].into_iter().chain(pairs)
    }
}

/// The colour of a step, as `#rrggbb`.
pub(super) fn color(shade: Shade) -> String {
    let [red, green, blue] = rgb(shade);
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// The colours of all steps, from the shortest to the longest.
static PALETTE: LazyLock<Vec<[u8; 3]>> = LazyLock::new(|| StretchScale::steps().map(rgb_of_step).collect());

/// The colour of a step: red, green and blue of sRGB.
pub(super) fn rgb(shade: Shade) -> [u8; 3] {
    shade.and_then(|step| PALETTE.get((step + STEPS) as usize)).copied().unwrap_or([0xa3; 3])
}

fn rgb_of_step(step: i32) -> [u8; 3] {
    const CORRECT: [f64; 3] = [17.0, 24.0, 39.0];
    const SHORTER: [[f64; 3]; 3] = [CORRECT, [29.0, 78.0, 216.0], [56.0, 189.0, 248.0]];
    const LONGER: [[f64; 3]; 3] = [CORRECT, [190.0, 62.0, 8.0], [251.0, 146.0, 20.0]];
    let [dark, middle, end] = if step < 0 { SHORTER } else { LONGER };
    // In the darkest third of a linear ramp no colour is visible; the exponent makes the colour start earlier.
    let along = (f64::from(step.abs()) / f64::from(STEPS)).powf(0.7) * 2.0;
    let (from, to, t) = if along <= 1.0 { (dark, middle, along) } else { (middle, end, along - 1.0) };
    [0, 1, 2].map(|channel| (from[channel] + (to[channel] - from[channel]) * t).round() as u8)
}

/// The colours of all steps, from the shortest to the longest, as `#rrggbb`.
pub(crate) fn colors() -> impl Iterator<Item = String> {
    StretchScale::steps().map(|step| color(Some(step)))
}

/// The smallest and largest stretch as text.
pub(crate) fn range_text(range: Option<[f64; 2]>) -> String {
    match range.filter(|[min, max]| min <= max) {
        None => "lengths on the part not measured".to_owned(),
        Some([min, max]) if percent(min) == percent(max) => {
            format!("length change on the part: {}", percent(min))
        }
        Some([min, max]) => format!("length change on the part: {} to {}", percent(min), percent(max)),
    }
}

/// A stretch as text: sign, a number with enough decimals, and unit.
pub(super) fn percent(stretch: f64) -> String {
    let value = stretch * 100.0;
    let decimals = match value.abs() {
        size if size >= 99.95 => 0,
        size if size >= 0.095 => 1,
        size if size >= 0.0095 => 2,
        _ => 3,
    };
    let digits = format!("{:.decimals$}", value.abs());
    let is_zero = digits.chars().all(|digit| digit == '0' || digit == '.');
    let sign = match value {
        _ if is_zero => "",
        value if value < 0.0 => "−",
        _ => "+",
    };
    let digits = if is_zero { "0" } else { digits.as_str() };
    format!("{sign}{digits} %")
}

/// The colour of everything beyond the scale on the long side.
pub(super) fn last_color() -> String {
    color(Some(STEPS))
}

/// A round value of the scale as text, such as `−2.5 %`.
pub(super) fn round_percent(stretch: f64) -> String {
    let digits = format!("{:.3}", stretch.abs() * 100.0);
    let digits = digits.trim_end_matches('0').trim_end_matches('.');
    let sign = match stretch {
        stretch if stretch < 0.0 => "−",
        stretch if stretch > 0.0 => "+",
        _ => "",
    };
    format!("{sign}{digits} %")
}

/// The smallest round number that is at least `stretch`, and at least 0.1 %, so that noise does not look like stretch.
fn round_limit(stretch: f64) -> f64 {
    let mut decade = 0.1;
    loop {
        for round in ROUND {
            let limit = decade * round / 100.0;
            // A margin in the tenth digit: 0.2 may be slightly more than the limit of 20 % because of rounding.
            if limit * (1.0 + 1e-10) >= stretch || decade >= 1e6 {
                return limit;
            }
        }
        decade *= 10.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_round_and_covers_the_data() {
        let limit = |stretch: f64| StretchScale::covering([(1.0, stretch)].into_iter()).limit;
        for (stretch, expected) in [(0.0, 0.001), (0.0007, 0.001), (-0.17, 0.2), (0.2, 0.2), (0.31, 0.4)] {
            assert!((limit(stretch) - expected).abs() < 1e-12, "{stretch}");
        }
    }

    #[test]
    fn one_segment_with_a_large_stretch_does_not_determine_the_scale() {
        let scale = StretchScale::covering([(100.0, 0.02), (0.1, 4.0)].into_iter());
        assert!((scale.limit - 0.02).abs() < 1e-12 && scale.exceeded);
        assert_eq!(scale.shade(4.0), Some(10));
    }

    #[test]
    fn correct_lengths_are_dark_and_unknown_ones_are_grey() {
        let scale = StretchScale { limit: 0.1, exceeded: false };
        assert_eq!(scale.shade(0.004), Some(0));
        assert_eq!(scale.shade(-0.1), Some(-10));
        assert_eq!(scale.shade(f64::NAN), None);
        assert_eq!(color(Some(0)), "#111827");
        assert_eq!(color(None), "#a3a3a3");
    }

    #[test]
    fn percentages_have_a_sign_and_a_unit() {
        for (stretch, text) in [
            (0.2284, "+22.8 %"),
            (-0.0312, "−3.1 %"),
            (0.00042, "+0.04 %"),
            (0.000_02, "+0.002 %"),
            (-1e-9, "0 %"),
            (1.5, "+150 %"),
        ] {
            assert_eq!(percent(stretch), text);
        }
        for (stretch, text) in [(-0.2, "−20 %"), (0.025, "+2.5 %"), (0.0, "0 %"), (1.0, "+100 %")] {
            assert_eq!(round_percent(stretch), text);
        }
    }
}
