//! Where elements are: transforms with their origin (SVG 1.1, chapter 7; CSS Transforms Level 1).

use nalgebra::{Matrix2, Vector2};

use super::length::number_of;
use super::style::Style;
use crate::geometry::pattern::Affine;

/// The map of an element with a style inside a viewport, or the reason why it cannot be read.
pub(super) fn own(style: &Style, viewport: Vector2<f64>) -> Result<Option<Affine>, &'static str> {
    if style.is_moved_by_css {
        return Err(
            "it is moved by `translate`, `rotate`, `scale` or `offset` in its style, which is not read: use \
                    `transform`, or convert it to paths",
        );
    }
    let Some(text) = &style.transform else { return Ok(None) };
    let map = transform(text, style.is_css_transform)
        .ok_or("its transform cannot be read: export the drawing again")?;
    let has_fixed_points = map.linear != Matrix2::identity();
    let Some(origin) = style.transform_origin.as_deref().filter(|_| has_fixed_points) else {
        return match style.has_own_box && has_fixed_points {
            true => Err(RELATIVE),
            false => Ok(Some(map)),
        };
    };
    if style.has_own_box {
        return Err(RELATIVE);
    }
    let origin = origin_of(origin, style, viewport)
        .ok_or("its `transform-origin` cannot be read: export the drawing again")?;
    let shift = |offset: Vector2<f64>| Affine { linear: Matrix2::identity(), offset };
    Ok(Some(shift(origin).after(&map).after(&shift(-origin))))
}

const RELATIVE: &str =
    "its transform is relative to its size (`transform-box`), which is not read: convert it to paths";

fn transform(text: &str, is_css: bool) -> Option<Affine> {
    let svgtypes::Transform { a, b, c, d, e, f } = match text.trim() {
        "" | "none" => svgtypes::Transform::default(),
        text if is_css => without_units(text)?.parse().ok()?,
        text => text.parse().ok()?,
    };
    Some(Affine { linear: Matrix2::new(a, c, b, d), offset: Vector2::new(e, f) })
}

/// The transforms of a style as an attribute has them. In a style, commas are between numbers, and lengths and angles
/// other than 0 have units.
fn without_units(text: &str) -> Option<String> {
    let mut plain = String::new();
    for function in text.split_inclusive(')') {
        let (name, numbers) = function.trim().strip_suffix(')')?.split_once('(')?;
        let unit = match name {
            "matrix" | "scale" => "",
            "translate" => "px",
            _ => "deg",
        };
        let number = |text: &str| {
            let is_zero = text.parse() == Ok(0.0);
            let number = if is_zero { text } else { text.strip_suffix(unit)? };
            number_of(number)
        };
        let numbers: Vec<f64> = numbers.split(',').map(|text| number(text.trim())).collect::<Option<_>>()?;
        plain += &format!("{name}({}) ", numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" "));
    }
    Some(plain)
}

/// The point that `transform-origin` names, in user units.
fn origin_of(text: &str, style: &Style, viewport: Vector2<f64>) -> Option<Vector2<f64>> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let is_vertical = |word: &&str| matches!(*word, "top" | "bottom");
    let is_horizontal = |word: &&str| matches!(*word, "left" | "right");
    let [x, y] = match words[..] {
        [one] if is_vertical(&one) => ["center", one],
        [one] => [one, "center"],
        [first, second] | [first, second, _] if is_vertical(&first) || is_horizontal(&second) => {
            [second, first]
        }
        [first, second] | [first, second, _] => [first, second],
        _ => return None,
    };
    let along = |word: &str, whole: f64| match word {
        "left" | "top" => Some(0.0),
        "center" => Some(whole / 2.0),
        "right" | "bottom" => Some(whole),
        length => style.length(length, whole),
    };
    Some(Vector2::new(along(x, viewport.x)?, along(y, viewport.y)?))
}
