//! Pictures as drawings: reads PNG and BMP files as the outlines of their dark areas, in mm.
//!
//! The size of a picture comes from the settings, else from the resolution that the file states. Without either the
//! picture is refused, because a guess would be marked. The centre of the picture is the drawing's origin.

use nalgebra::Vector2;

use super::error::PatternReadError;
use super::facts::{LayerFacts, PatternFacts, RasterFacts};
use super::reading::{PatternOptions, PatternReading, size_notice};
use super::units::DrawingUnit;
use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
use crate::geometry::space::FlatPoint;
use crate::reason::Notice;

pub(super) mod options;
mod decode;
mod trace;
mod polygon;

pub(super) use decode::RasterFormat;
pub use options::RasterOptions;

use decode::{Decoded, Picture};
use polygon::{Fineness, Outline};

/// The layer of all outlines of a picture.
const LAYER: &str = "PICTURE";
const COLOR: Color = Color::Aci(7);
/// Largest distance of an outline from a smooth edge, pixels: as exact as 8 bits and anti-aliasing allow.
const PIXEL_TOLERANCE: f64 = 0.05;
/// Smallest tolerance that is useful, mm: a tenth of the usual tolerance of the corrected lines.
const MIN_TOLERANCE: f64 = 0.001;
/// Hard-edged pixels of at least this size, mm, are a drawing of squares, such as a code with one pixel per module.
const SQUARE_PIXEL: f64 = 0.2;
/// Largest number of corners of all outlines together; with more, the picture is noise.
const MAX_CORNERS: usize = 1_000_000;
/// Largest number of corners at a quick pace.
const QUICK_CORNERS: usize = 20_000;
/// Outlines that enclose less than this, square pixels, are specks.
const SPECK: f64 = 4.0;
/// This many specks, if they are more than the other outlines, lead to a notice.
const MANY_SPECKS: usize = 20;
/// A larger share of grey pixels than this means that the picture has shades.
const MANY_SHADES: f64 = 0.05;
/// Number of grey pixels at smooth edges, for each pixel side on a border.
const GREY_AT_EDGES: usize = 2;
/// A larger relative difference between the pixels' width and height leads to a notice.
const STRETCH: f64 = 0.01;
/// Resolutions that programs write by default.
const DEFAULT_DPI: [f64; 3] = [72.0, 90.0, 96.0];

/// Width and height of a picture, mm, and the reason for them.
struct Size {
    size: Vector2<f64>,
    why: String,
}

pub(super) fn read(
    bytes: &[u8],
    format: RasterFormat,
    options: &PatternOptions,
) -> Result<PatternReading, PatternReadError> {
    let settings = &options.picture;
    let decoded = decode::decode(bytes, format, settings.inverted, options.pace)?;
    let picture = &decoded.picture;
    let pixels = Vector2::new(picture.width as f64, picture.height as f64);
    let Size { size, why } = size(&decoded, settings)?;
    let pixel = size.component_div(&pixels);
    let fineness = Fineness {
        tolerance: (MIN_TOLERANCE / pixel.max()).clamp(PIXEL_TOLERANCE, 0.5),
        pixels_are_squares: pixel.min() >= SQUARE_PIXEL,
    };
    let darkness = if settings.inverted { settings.threshold } else { 1.0 - settings.threshold };
    // Half a step lower, so that at 50 % the darker one of the two middle greys is ink.
    let level = (darkness * f64::from(Picture::FULL) - 0.5).clamp(0.0, f64::from(Picture::FULL) - 1.0) as u16;
    let blank = picture.ink.iter().filter(|ink| **ink <= level).count();
    if blank == 0 || blank == picture.ink.len() {
        return Err(nothing_to_mark(&decoded, settings, blank == 0));
    }

    let mut outlines: Vec<Outline> = Vec::new();
    let (mut corners, mut sides) = (0, 0);
    trace::borders(picture, level, |walk| {
        let outline = polygon::outline(walk, &trace::places(picture, level, walk), &fineness);
        sides += walk.len();
        corners += outline.corners.len();
        if corners > MAX_CORNERS {
            return Err(PatternReadError::TooMany {
                what: "corners in its outlines",
                limit: MAX_CORNERS,
                entity: None,
            });
        }
        if !options.pace.allows(corners, QUICK_CORNERS) {
            return Err(PatternReadError::TakesLong);
        }
        outlines.push(outline);
        Ok(())
    })?;

    let place =
        |at: &Vector2<f64>| FlatPoint::new(at.x * pixel.x - size.x / 2.0, size.y / 2.0 - at.y * pixel.y);
    let paths: Vec<Path> = outlines
        .iter()
        .map(|outline| {
            let points: Vec<FlatPoint> = outline.corners.iter().map(place).collect();
            let ends = points.iter().zip(points.iter().cycle().skip(1));
            Path {
                layer: 0,
                color: Color::ByLayer,
                shape: Shape::Closed(ends.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect()),
                region: Some(0),
                source: Source { entity: format.name().into(), ..Source::default() },
            }
        })
        .collect();
    let pattern = Pattern { layers: vec![Layer { name: LAYER.into(), color: COLOR }], paths };

    let notices = notices(&decoded, settings, &outlines, sides, pixel, blank);
    let extents = pattern.extents();
    let contours = pattern.paths.len();
    let mut facts = PatternFacts {
        producer: None,
        version: format!("{} picture, {}", format.name(), decoded.colors),
        unit: DrawingUnit::Millimetre,
        unit_why: why.clone(),
        size: extents.size().into(),
        extents: [extents.min.x, extents.min.y, extents.max.x, extents.max.y],
        entities: [("outline".into(), [(LAYER.into(), contours)].into())].into(),
        layers: [(LAYER.into(), LayerFacts { color: COLOR.to_string(), paths: contours, hidden: None })]
            .into(),
        skipped: Vec::new(),
        repairs: Vec::new(),
        notices,
        fields: Vec::new(),
        picture: Some(RasterFacts {
            pixels: [picture.width, picture.height],
            size: size.into(),
            size_why: why,
            dots_per_inch: decoded.density.map(decode::dots_per_inch),
            threshold_percent: settings.threshold * 100.0,
            inverted: settings.inverted,
            contours,
            vertices: corners,
        }),
    };
    facts.notices.extend(size_notice(&facts));
    Ok(PatternReading { pattern, facts })
}

/// The size of the whole picture, from the settings, else from the file.
fn size(decoded: &Decoded, settings: &RasterOptions) -> Result<Size, PatternReadError> {
    let pixels = [decoded.picture.width, decoded.picture.height];
    let [columns, rows] = pixels.map(|count| count as f64);
    // A missing side follows from the other one and the shape of the pixels.
    let ratio = rows / columns * decoded.pixel_aspect;
    let (width, height, why) = match (settings.width, settings.height, decoded.density) {
        (Some(width), Some(height), _) => {
            (width, height, format!("the settings give the size {width} x {height} mm"))
        }
        (Some(width), None, _) => (width, width * ratio, format!("the settings give the width {width} mm")),
        (None, Some(height), _) => {
            (height / ratio, height, format!("the settings give the height {height} mm"))
        }
        (None, None, Some(density)) => {
            let [x, y] = decode::dots_per_inch(density);
            let dpi = if x == y { format!("{x:.1}") } else { format!("{x:.1} x {y:.1}") };
            (columns / density[0], rows / density[1], format!("the file states {dpi} pixels per inch"))
        }
        (None, None, None) => return Err(PatternReadError::PictureWithoutSize { pixels }),
    };
    let size = Vector2::new(width, height);
    let is_sensible = size.iter().all(|side| side.is_finite() && *side > 0.0);
    if is_sensible { Ok(Size { size, why }) } else { Err(PatternReadError::PictureWithoutSize { pixels }) }
}

fn nothing_to_mark(decoded: &Decoded, settings: &RasterOptions, is_all_ink: bool) -> PatternReadError {
    let percent = settings.threshold * 100.0;
    let (side, other) =
        if settings.inverted == is_all_ink { ("lighter", "raise") } else { ("darker", "lower") };
    let found = format!(
        "all pixels are {side} than the threshold of {percent} %{}",
        if is_all_ink { ", so there is no outline" } else { "" }
    );
    let remedy = if !is_all_ink && decoded.has_transparency {
        let (drawn, option) = if settings.inverted { ("dark", "without") } else { ("light", "with") };
        format!(
            "If the drawing is {drawn} on a transparent background, read it {option} `--invert` (`invert` in the \
             settings); otherwise change `--threshold`. Transparent pixels are never marked."
        )
    } else {
        format!(
            "Check that this is the right picture; if it is, {other} `threshold_percent` under [pattern] (`--threshold`)."
        )
    };
    PatternReadError::NothingToMark { found, remedy }
}

fn notices(
    decoded: &Decoded,
    settings: &RasterOptions,
    outlines: &[Outline],
    sides: usize,
    pixel: Vector2<f64>,
    blank: usize,
) -> Vec<Notice> {
    let mut notices = Vec::new();
    let ink = &decoded.picture.ink;
    let (light, dark) = (Picture::FULL / 8, Picture::FULL - Picture::FULL / 8);
    let grey = ink.iter().filter(|ink| (light..dark).contains(ink)).count();
    if grey as f64 > MANY_SHADES * ink.len() as f64 && grey > GREY_AT_EDGES * sides {
        let percent = 100.0 * grey as f64 / ink.len() as f64;
        let message = format!(
            "{percent:.0} % of the picture is neither dark nor light; only the outlines at a threshold of {:.0} % are \
             marked, shades are not converted to dots",
            settings.threshold * 100.0
        );
        notices.push(Notice::warning("picture-shades", message));
    }
    let specks = outlines.iter().filter(|outline| outline.area() < SPECK).count();
    if specks >= MANY_SPECKS && 2 * specks > outlines.len() {
        let message = format!(
            "{specks} of {} outlines are specks of a few pixels; if they are noise, clean the picture or change the \
             threshold",
            outlines.len()
        );
        notices.push(Notice::warning("picture-specks", message));
    }
    let [columns, rows] = [decoded.picture.width, decoded.picture.height];
    let stretch = pixel.y / pixel.x / decoded.pixel_aspect;
    if (stretch - 1.0).abs() > STRETCH {
        let message = format!(
            "the given size stretches the {columns} x {rows} pixels: heights by {stretch:.3} relative to widths; give \
             only the width or only the height to keep the picture's shape"
        );
        notices.push(Notice::warning("picture-stretched", message));
    }
    if settings.width.is_none()
        && settings.height.is_none()
        && let Some(density) = decoded.density
    {
        let [x, _] = decode::dots_per_inch(density);
        if let Some(dpi) = DEFAULT_DPI.iter().find(|dpi| (x - **dpi).abs() < 0.1) {
            let message = format!(
                "the size comes from the {dpi:.0} pixels per inch in the file, which many programs write by default; \
                 if the size is wrong, give the width in mm"
            );
            notices.push(Notice::note("picture-resolution", message));
        }
    }
    let hard = outlines.iter().filter(|outline| outline.is_hard && outline.corners.len() > 4).count();
    if 2 * hard > outlines.len() {
        let message = if pixel.min() >= SQUARE_PIXEL {
            format!(
                "the picture has hard edges and pixels of {:.3} mm; the pixels are marked as squares",
                pixel.max()
            )
        } else {
            format!(
                "the picture has hard edges, so slanting outlines are exact only to half a pixel, {:.3} mm; a picture \
                 with smooth edges gives more exact outlines",
                pixel.max() / 2.0
            )
        };
        notices.push(Notice::note("picture-hard-edges", message));
    }
    if 2 * blank < ink.len() && ink_on_all_sides(&decoded.picture) {
        let message = "most of the picture and its border are marked; if the background must stay blank, read the \
                       picture inverted (`--invert`)";
        notices.push(Notice::note("picture-ground", message));
    }
    if decoded.is_animated {
        notices.push(Notice::warning(
            "picture-animated",
            "the picture is animated; only its first frame is read",
        ));
    }
    if decoded.was_turned {
        notices.push(Notice::note(
            "picture-turned",
            "the picture was rotated or mirrored as its file requires (Exif orientation)",
        ));
    }
    notices
}

fn ink_on_all_sides(picture: &Picture) -> bool {
    let (width, height) = (picture.width as i64, picture.height as i64);
    let corners = [(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)];
    corners.iter().all(|(x, y)| picture.ink_at(*x, *y) > Picture::FULL / 2)
}
