//! The page: its size in mm, and the map from user units to mm.

use std::str::FromStr;

use nalgebra::{Matrix2, Vector2};
use roxmltree::{Document, Node, NodeType};
use svgtypes::{Align, AspectRatio, ViewBox};

use super::super::PatternOptions;
use super::super::units::DrawingUnit;
use super::document::attribute;
use super::length::{Length, Unit};
use super::style::Style;
use crate::geometry::pattern::Affine;
use crate::geometry::space::{Extents, FlatPoint};
use crate::reason::Notice;

/// Size of a page without `width`, `height` and `viewBox`, pixels: the default of CSS for replaced elements.
const DEFAULT_SIZE: [f64; 2] = [300.0, 150.0];
/// A larger relative difference between the scales along x and y leads to a notice.
const STRETCH: f64 = 0.001;

pub(super) struct Page {
    /// From user units to mm, with y up and the origin at the page's lower left corner.
    pub(super) to_mm: Affine,
    /// Width and height of the page in user units, for percentages.
    pub(super) viewport: Vector2<f64>,
    /// Width and height of the page, mm; `None` if the file states none.
    pub(super) size: Option<Vector2<f64>>,
    /// What is shown of the drawing, mm: the page, or the part of it that the `viewBox` is fitted to.
    pub(super) shown: Extents,
    /// Size of a CSS pixel on the page, mm.
    pub(super) pixel: f64,
    pub(super) unit: DrawingUnit,
    pub(super) why: String,
    pub(super) notices: Vec<Notice>,
}

/// A property of the page that cannot be read.
#[derive(Debug)]
pub(super) struct Unread {
    pub(super) what: &'static str,
    pub(super) text: String,
    /// What is wrong with it, as the end of a sentence.
    pub(super) why: &'static str,
}

impl Unread {
    fn new(what: &'static str, text: &str, why: &'static str) -> Self {
        Self { what, text: text.chars().take(100).collect(), why }
    }

    /// A rule that may set it; `why` names the rule.
    fn uncertain(what: &'static str, why: &str) -> Self {
        Self { text: why.to_owned(), ..Self::new(what, "", "is not certain") }
    }
}

/// How many mm a length is, and whether it depends on the size of a pixel; `None` for a share of the window.
fn in_mm(length: Length, style: &Style, pixel: f64) -> Option<(f64, bool)> {
    let absolute = length.user_units(style.scale(0.0)) * DrawingUnit::Pixel96.in_mm();
    match length.unit {
        Unit::Percent => None,
        Unit::None => Some((length.number * pixel, true)),
        Unit::Px | Unit::Em | Unit::Ex | Unit::Rem => Some((absolute, true)),
        _ => Some((absolute, false)),
    }
}

/// The width or height of the page, as style or attribute, which must be a size. Words such as `auto` state none, and a share of the
/// window in a style states less than the attribute.
fn side(root: Node<'_, '_>, style: &Style, what: &'static str) -> Result<Option<Length>, Unread> {
    const NO_SIZE: &str = "is not a size";
    let is_word = |text: &str| text.chars().all(|letter| letter.is_ascii_alphabetic() || letter == '-');
    if let Some(why) = style.unread_geometry(what) {
        return Err(Unread::uncertain(what, why));
    }
    let mut found = None;
    if let Some(text) = style.geometry(what).filter(|text| !is_word(text)) {
        let length = Length::parsed(text).filter(is_size).ok_or(Unread::new(what, text, NO_SIZE))?;
        if length.unit == Unit::None {
            return Err(Unread::new(what, text, "has no unit, and CSS ignores it in a style"));
        }
        found = Some(length);
    }
    if found.is_none_or(|length| length.unit == Unit::Percent)
        && let Some(text) =
            attribute(root, what).map(str::trim).filter(|text| !text.is_empty() && *text != "auto")
    {
        // Some programs write `40 mm`, which can mean nothing else.
        let unit = text.trim_end_matches(|letter: char| letter.is_ascii_alphabetic() || letter == '%').len();
        let joined = format!("{}{}", text[..unit].trim_end(), &text[unit..]);
        found = Some(Length::parsed(&joined).filter(is_size).ok_or(Unread::new(what, text, NO_SIZE))?);
    }
    Ok(found)
}

fn is_size(length: &Length) -> bool {
    length.number > 0.0
}

/// Refuses limits of the page's size in a style that change it.
fn check_limits(style: &Style, own: Vector2<f64>) -> Result<(), Unread> {
    const LIMITS: [(&str, usize, bool); 4] =
        [("min-width", 0, false), ("max-width", 0, true), ("min-height", 1, false), ("max-height", 1, true)];
    for (what, axis, is_largest) in LIMITS {
        if let Some(why) = style.unread_geometry(what) {
            return Err(Unread::uncertain(what, why));
        }
        let Some(text) = style.geometry(what) else { continue };
        let Some(length) = Length::parsed(text) else { continue };
        let Some((limit, _)) = in_mm(length, style, DrawingUnit::Pixel96.in_mm()) else { continue };
        let is_changed = if is_largest { limit < own[axis] } else { limit > own[axis] };
        if is_changed && length.unit != Unit::None {
            return Err(Unread::new(
                what,
                text,
                "changes the size of the page in a browser and not elsewhere",
            ));
        }
    }
    Ok(())
}

/// The `viewBox` of an element, if it has a valid one.
pub(super) fn view_box(node: Node<'_, '_>) -> Option<ViewBox> {
    let view = ViewBox::from_str(attribute(node, "viewBox")?).ok()?;
    let is_valid = [view.x, view.y, view.w, view.h].iter().all(|value| value.is_finite());
    (is_valid && view.w > 0.0 && view.h > 0.0).then_some(view)
}

/// The map from a `viewBox` to a rectangle of this size at the origin, with the element's `preserveAspectRatio`.
pub(super) fn fitted(node: Node<'_, '_>, view: ViewBox, size: Vector2<f64>) -> Affine {
    let aspect = attribute(node, "preserveAspectRatio")
        .and_then(|value| AspectRatio::from_str(value).ok())
        .unwrap_or(AspectRatio { defer: false, align: Align::XMidYMid, slice: false });
    let mut scale = Vector2::new(size.x / view.w, size.y / view.h);
    if aspect.align != Align::None {
        let both = if aspect.slice { scale.x.max(scale.y) } else { scale.x.min(scale.y) };
        scale = Vector2::new(both, both);
    }
    let [x, y] = match aspect.align {
        Align::None | Align::XMinYMin => [0.0, 0.0],
        Align::XMidYMin => [0.5, 0.0],
        Align::XMaxYMin => [1.0, 0.0],
        Align::XMinYMid => [0.0, 0.5],
        Align::XMidYMid => [0.5, 0.5],
        Align::XMaxYMid => [1.0, 0.5],
        Align::XMinYMax => [0.0, 1.0],
        Align::XMidYMax => [0.5, 1.0],
        Align::XMaxYMax => [1.0, 1.0],
    };
    let left = Vector2::new(size.x - view.w * scale.x, size.y - view.h * scale.y);
    let offset = Vector2::new(left.x * x - view.x * scale.x, left.y * y - view.y * scale.y);
    Affine { linear: Matrix2::from_diagonal(&scale), offset }
}

/// The page of a drawing by a producer.
pub(super) fn page(
    root: Node<'_, '_>,
    style: &Style,
    producer: Option<&str>,
    options: &PatternOptions,
) -> Result<Page, Unread> {
    let view = view_box(root);
    let view_text = attribute(root, "viewBox").filter(|text| !text.trim().is_empty());
    if let (None, Some(text)) = (view, view_text) {
        return Err(Unread::new("viewBox", text, "is not a position and a size"));
    }
    let is_by_unit = options.unit.is_some() && view.is_some();
    let (width, height) = match is_by_unit {
        true => (None, None),
        false => (side(root, style, "width")?, side(root, style, "height")?),
    };
    let mut notices = Vec::new();

    let unitless = options.unit.or(options.unit_if_unitless);
    let pixel = unitless.map_or(DrawingUnit::Pixel96.in_mm(), DrawingUnit::in_mm);
    let [given_width, given_height] =
        [width, height].map(|side| side.and_then(|length| in_mm(length, style, pixel)));
    let in_pixels =
        [given_width, given_height].iter().flatten().next().is_none_or(|(_, of_pixels)| *of_pixels);
    let own = match (given_width, given_height, view) {
        (Some((width, _)), Some((height, _)), _) => Vector2::new(width, height),
        (Some((width, _)), None, Some(view)) => Vector2::new(width, width * view.h / view.w),
        (None, Some((height, _)), Some(view)) => Vector2::new(height * view.w / view.h, height),
        (None, None, Some(view)) => Vector2::new(view.w, view.h) * pixel,
        (width, height, None) => Vector2::new(
            width.map_or(DEFAULT_SIZE[0] * pixel, |(width, _)| width),
            height.map_or(DEFAULT_SIZE[1] * pixel, |(height, _)| height),
        ),
    };
    if !is_by_unit {
        check_limits(style, own)?;
    }
    // Units along x and y of the page before the settings stretch it.
    let user = view.map_or_else(
        || Affine {
            linear: Matrix2::identity() * pixel_of(&[width, height], pixel),
            offset: Vector2::zeros(),
        },
        |view| fitted(root, view, own),
    );
    let settings = &options.picture;
    let size = match (settings.width, settings.height) {
        (Some(width), Some(height)) => Vector2::new(width, height),
        (Some(width), None) => own * (width / own.x),
        (None, Some(height)) => own * (height / own.y),
        (None, None) => own,
    };
    let scale = size.component_div(&own);
    let is_scaled = settings.width.is_some() || settings.height.is_some();
    if (scale.x / scale.y - 1.0).abs() > STRETCH {
        let message = format!(
            "the given size stretches the page of {:.3} x {:.3} mm: heights by {:.3} relative to widths; give only the \
             width or only the height to keep its shape",
            own.x,
            own.y,
            scale.y / scale.x
        );
        notices.push(Notice::warning("picture-stretched", message));
    }

    let sign = |length: Option<Length>| match length.map(|length| length.unit) {
        Some(Unit::Mm | Unit::Quarter) => DrawingUnit::Millimetre,
        Some(Unit::Cm) => DrawingUnit::Centimetre,
        Some(Unit::In) => DrawingUnit::Inch,
        Some(Unit::Pt | Unit::Pc) => DrawingUnit::Point72,
        Some(Unit::None) | None => unitless.unwrap_or(DrawingUnit::Pixel96),
        _ => DrawingUnit::Pixel96,
    };
    let named = if given_width.is_some() { width } else { height.filter(|_| given_height.is_some()) };
    let unit = if is_scaled { DrawingUnit::Millimetre } else { sign(named) };
    let page = format!("the page is {:.3} x {:.3} mm", size.x, size.y);
    let why = match (is_scaled, in_pixels, unitless, named) {
        (true, ..) => format!("{page} because the settings give its size"),
        (false, false, ..) => format!("{page} by its width and height"),
        (false, true, Some(unit), None | Some(Length { unit: Unit::None, .. })) => {
            format!("{page}: the file states no unit, and the settings set {unit}")
        }
        (false, true, _, Some(_)) => format!("{page}: its width and height are in pixels of 1/96 inch"),
        (false, true, _, None) => {
            format!("{page}: the file states no size, so its units are pixels of 1/96 inch")
        }
    };
    if !is_scaled && unitless.is_none() && named.is_none() {
        let message = format!(
            "pixels of 1/96 inch assumed: the file states no size, so {page}; if this is wrong, give its width \
             (`--width`, `width_mm` under [pattern]), or export with the width and height in mm"
        );
        notices.push(Notice::note("unit-assumed", message));
    }
    let other = producer.filter(|_| in_pixels && !is_scaled && unitless.is_none()).and_then(other_resolution);
    if let (Some(dpi), Some(producer)) = (other, producer) {
        let [width, height] = [size.x, size.y].map(|side| side * 96.0 / dpi);
        let message = format!(
            "the size of the page is in pixels. {producer} has {dpi:.0} pixels per inch, other programs 96: the page is \
             {:.3} x {:.3} mm here, and {width:.3} x {height:.3} mm in {producer}; if that is the size, give `--width \
             {width:.3}` (`width_mm` under [pattern]), or export with the width and height in mm",
            size.x, size.y
        );
        notices.push(Notice::warning("svg-pixels", message));
    }

    let linear = Matrix2::from_diagonal(&Vector2::new(scale.x, -scale.y));
    let to_page = Affine { linear, offset: Vector2::new(0.0, size.y) };
    let viewport =
        view.map_or_else(|| own / pixel_of(&[width, height], pixel), |view| Vector2::new(view.w, view.h));
    let to_mm = to_page.after(&user);
    let mut shown = Extents { min: Vector2::zeros(), max: size };
    if let Some(view) = view {
        let corners = [[view.x, view.y], [view.x + view.w, view.y + view.h]];
        let seen = Extents::of(corners.map(|[x, y]| to_mm.point(FlatPoint::new(x, y)).coords()));
        shown = Extents { min: shown.min.sup(&seen.min), max: shown.max.inf(&seen.max) };
    }
    Ok(Page {
        to_mm,
        viewport,
        size: Some(size).filter(|_| view.is_some() || given_width.is_some() || given_height.is_some()),
        shown,
        pixel: DrawingUnit::Pixel96.in_mm() * (scale.x * scale.y).sqrt(),
        unit,
        why,
        notices,
    })
}

/// The size of a user unit of a page without `viewBox`, mm: a pixel, or the unit that the settings give to numbers without
/// one.
fn pixel_of(sides: &[Option<Length>; 2], pixel: f64) -> f64 {
    let has_unit = sides.iter().flatten().any(|side| side.unit != Unit::None && side.unit != Unit::Percent);
    if has_unit { DrawingUnit::Pixel96.in_mm() } else { pixel }
}

/// The pixels per inch of programs that do not use 96.
fn other_resolution(producer: &str) -> Option<f64> {
    let lower = producer.to_lowercase();
    if lower.contains("illustrator") {
        return Some(72.0);
    }
    let version = lower.strip_prefix("inkscape ")?;
    let mut numbers = version.split(['.', ' ', '+', '-']).map(|number| {
        let digits = number.trim_end_matches(|letter: char| !letter.is_ascii_digit());
        digits.parse::<u32>().ok()
    });
    let (major, minor) = (numbers.next()??, numbers.next()??);
    (major == 0 && minor < 92).then_some(90.0)
}

/// The program that wrote the file, by its attributes or its first comment.
pub(super) fn producer(document: &Document<'_>) -> Option<String> {
    let root = document.root_element();
    let of = |name: &str| {
        root.attributes().find(|attribute| {
            attribute.name() == name && attribute.namespace().is_some_and(|space| space.contains("inkscape"))
        })
    };
    if let Some(version) = of("version") {
        let number = version.value().split(" (").next().unwrap_or_default();
        return Some(format!("Inkscape {number}"));
    }
    let mut comments = document
        .root()
        .children()
        .chain(root.children().take(4))
        .filter(|node| node.node_type() == NodeType::Comment)
        .filter_map(|comment| comment.text());
    if let Some(comment) = comments.find(|text| {
        let lower = text.to_lowercase();
        ["generator", "creator", "created with", "generated by"].iter().any(|word| lower.contains(word))
    }) {
        let text = comment.trim();
        let named = ["Generator:", "Creator:", "Created with", "Generated by"]
            .iter()
            .find_map(|word| text.strip_prefix(word))
            .unwrap_or(text);
        return Some(
            named.trim().split(", SVG Export").next().unwrap_or_default().chars().take(100).collect(),
        );
    }
    let is_of = |maker: &str| root.namespaces().any(|space| space.uri().contains(maker));
    if is_of("serif.com") {
        return Some("Affinity (recognised by its namespace)".into());
    }
    // Its comment may have been removed.
    let is = |name: &str, value: &str| attribute(root, name).is_some_and(|text| text.trim() == value);
    let has_background = attribute(root, "enable-background").is_some()
        || attribute(root, "style").is_some_and(|style| style.contains("enable-background"));
    let is_illustrator =
        is_of("ns.adobe.com/AdobeIllustrator") || has_background || is("x", "0px") && is("y", "0px");
    is_illustrator.then(|| "Adobe Illustrator (recognised by its attributes)".into())
}
