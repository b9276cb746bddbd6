//! Decodes PNG and BMP files to the ink of every pixel, after checking size and completeness.

use std::io::Cursor;

use image::codecs::bmp::BmpDecoder;
use image::codecs::png::PngDecoder;
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, Limits};

use super::super::error::{PatternReadError, Spot};
use crate::formats::Pace;

/// Largest number of pixels: a sheet of A4 at 600 dpi has 35 million.
const MAX_PIXELS: u64 = 64_000_000;
/// Largest number of pixels at a quick pace.
const QUICK_PIXELS: usize = 4_000_000;
/// Largest decoded picture, bytes: [`MAX_PIXELS`] with four channels of 8 bits.
const MAX_BYTES: u64 = 4 * MAX_PIXELS;

const PNG_MARK: &[u8] = b"\x89PNG\r\n\x1a\n";
const INCH: f64 = 25.4;

/// The format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum RasterFormat {
    Png,
    Bmp,
}

/// The ink of every pixel, from 0 (not marked) to [`Picture::FULL`] (marked).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Row by row from the top.
    pub(super) ink: Vec<u16>,
}

/// A decoded picture with the facts about its file.
pub(super) struct Decoded {
    pub(super) picture: Picture,
    /// Pixels per mm along x and y, if the file states them.
    pub(super) density: Option<[f64; 2]>,
    /// Height of a pixel divided by its width, 1 if the file does not state it.
    pub(super) pixel_aspect: f64,
    /// Channels and depth as text.
    pub(super) colors: String,
    /// Whether further pictures follow the first one.
    pub(super) is_animated: bool,
    /// Whether the picture was rotated or mirrored as the file requires.
    pub(super) was_turned: bool,
    /// Whether some pixels are not opaque.
    pub(super) has_transparency: bool,
}

/// The metadata of a file, read without decoding it.
#[derive(Default)]
struct Frame {
    density: Option<[f64; 2]>,
    pixel_aspect: Option<f64>,
    is_animated: bool,
    is_apple: bool,
    depth: u8,
    is_palette: bool,
    /// The length of the file, if it ends too early.
    cut: Option<usize>,
}

impl RasterFormat {
    /// The format, by the first bytes; the beginning of a format's mark is enough for a file that is being written.
    pub(in super::super) fn of(bytes: &[u8]) -> Option<Self> {
        let mark = bytes.len().clamp(1, PNG_MARK.len());
        if bytes.get(..mark) == PNG_MARK.get(..mark) {
            Some(Self::Png)
        } else if bytes.starts_with(b"BM") && (bytes.len() < 18 || word(bytes, 14) <= Some(124)) {
            Some(Self::Bmp)
        } else {
            None
        }
    }

    pub(in super::super) fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Bmp => "BMP",
        }
    }

    /// Whether the file is complete.
    pub(in super::super) fn is_complete(self, bytes: &[u8]) -> bool {
        self.frame(bytes).cut.is_none()
    }

    fn frame(self, bytes: &[u8]) -> Frame {
        match self {
            Self::Png => png_frame(bytes),
            Self::Bmp => bmp_frame(bytes),
        }
    }
}

impl Picture {
    pub(super) const FULL: u16 = u16::MAX;

    /// The ink of the pixel at (x, y), y down; outside the picture there is none.
    pub(super) fn ink_at(&self, x: i64, y: i64) -> u16 {
        let inside = (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y);
        if inside { self.ink[y as usize * self.width + x as usize] } else { 0 }
    }
}

/// Decodes a picture. Dark pixels have ink, or light ones if `inverted`; transparent pixels have none.
pub(super) fn decode(
    bytes: &[u8],
    format: RasterFormat,
    inverted: bool,
    pace: Pace,
) -> Result<Decoded, PatternReadError> {
    let frame = format.frame(bytes);
    let damaged = |what: String| PatternReadError::PictureDamaged { format: format.name(), what };
    if let Some(end) = frame.cut {
        return Err(PatternReadError::PictureTruncated {
            format: format.name(),
            spot: Spot::Byte(end as u64),
        });
    }
    if frame.is_apple {
        return Err(damaged("it is in Apple's variant of PNG for apps (CgBI)".into()));
    }
    let error_of = |error: image::ImageError| damaged(error.to_string());
    match format {
        RasterFormat::Png => {
            let mut limits = Limits::no_limits();
            limits.max_alloc = Some(2 * MAX_BYTES);
            let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(error_of)?;
            read(decoder, &frame, inverted, pace, error_of)
        }
        RasterFormat::Bmp => {
            read(BmpDecoder::new(Cursor::new(bytes)).map_err(error_of)?, &frame, inverted, pace, error_of)
        }
    }
}

fn read(
    mut decoder: impl ImageDecoder,
    frame: &Frame,
    inverted: bool,
    pace: Pace,
    error_of: impl Fn(image::ImageError) -> PatternReadError + Copy,
) -> Result<Decoded, PatternReadError> {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let size = decoder.total_bytes();
    if pixels > MAX_PIXELS || size > MAX_BYTES {
        let limit = if pixels > MAX_PIXELS { MAX_PIXELS } else { MAX_BYTES * pixels / size.max(1) };
        return Err(PatternReadError::PictureTooLarge { pixels: [width, height], limit });
    }
    if !pace.allows(pixels as usize, QUICK_PIXELS) {
        return Err(PatternReadError::TakesLong);
    }
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let color = decoder.color_type();
    let mut samples = vec![0; size as usize];
    decoder.read_image(&mut samples).map_err(error_of)?;

    let is_wide = color.bytes_per_pixel() / color.channel_count() == 2;
    let opaque = u32::from(Picture::FULL);
    let mut has_transparency = false;
    let channels = usize::from(color.channel_count());
    let (is_grey, has_alpha) = (channels < 3, color.has_alpha());
    let ink_of = |pixel: &[u8], has_transparency: &mut bool| -> u16 {
        let sample = |channel: usize| {
            if is_wide {
                u32::from(u16::from_ne_bytes([pixel[2 * channel], pixel[2 * channel + 1]]))
            } else {
                u32::from(pixel[channel]) * 257
            }
        };
        // ITU-R BT.709-6 (2015), item 3.2: weights of the encoded channels. Programs that draw smooth edges also mix
        // encoded values, so the mean of black and white is a pixel that is half covered.
        let light = if is_grey {
            sample(0)
        } else {
            (2126 * sample(0) + 7152 * sample(1) + 722 * sample(2)) / 10_000
        };
        let ink = if inverted { light } else { opaque - light };
        let alpha = if has_alpha { sample(channels - 1) } else { opaque };
        *has_transparency |= alpha < opaque;
        (u64::from(ink) * u64::from(alpha) / u64::from(opaque)) as u16
    };
    let pixels = samples.chunks_exact(usize::from(color.bytes_per_pixel()));
    let ink = pixels.map(|pixel| ink_of(pixel, &mut has_transparency)).collect();
    let picture = Picture { width: width as usize, height: height as usize, ink };
    let (picture, is_across) = turned(picture, orientation);
    let (density, aspect) = (frame.density, frame.pixel_aspect.unwrap_or(1.0));
    Ok(Decoded {
        picture,
        density: if is_across { density.map(|[x, y]| [y, x]) } else { density },
        pixel_aspect: if is_across { 1.0 / aspect } else { aspect },
        colors: colors(color, frame),
        is_animated: frame.is_animated,
        was_turned: orientation != Orientation::NoTransforms,
        has_transparency,
    })
}

/// The picture, rotated and mirrored as its Orientation tag requires (Exif 2.3), and whether rows became columns.
fn turned(picture: Picture, orientation: Orientation) -> (Picture, bool) {
    // For the pixel at (x, y): exchange x and y, then mirror along x or y, to get its pixel in the old picture.
    let (exchange, flip_x, flip_y) = match orientation {
        Orientation::NoTransforms => return (picture, false),
        Orientation::FlipHorizontal => (false, true, false),
        Orientation::Rotate180 => (false, true, true),
        Orientation::FlipVertical => (false, false, true),
        Orientation::Rotate90FlipH => (true, false, false),
        Orientation::Rotate90 => (true, false, true),
        Orientation::Rotate270FlipH => (true, true, true),
        Orientation::Rotate270 => (true, true, false),
    };
    let (old_width, old_height) = (picture.width, picture.height);
    let (width, height) = if exchange { (old_height, old_width) } else { (old_width, old_height) };
    let mut ink = Vec::with_capacity(picture.ink.len());
    for y in 0..height {
        for x in 0..width {
            let (old_x, old_y) = if exchange { (y, x) } else { (x, y) };
            let old_x = if flip_x { old_width - 1 - old_x } else { old_x };
            let old_y = if flip_y { old_height - 1 - old_y } else { old_y };
            ink.push(picture.ink[old_y * old_width + old_x]);
        }
    }
    (Picture { width, height, ink }, exchange)
}

fn colors(color: ColorType, frame: &Frame) -> String {
    let depth =
        if frame.depth == 0 { color.bytes_per_pixel() / color.channel_count() * 8 } else { frame.depth };
    let channels = match (frame.is_palette, color.channel_count()) {
        (true, _) => "palette",
        (false, 1) => "grey",
        (false, 2) => "grey with transparency",
        (false, 3) => "colours",
        (false, _) => "colours with transparency",
    };
    format!("{depth} bit {channels}")
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// Walks over the chunks of a PNG file up to its IEND (Portable Network Graphics, third edition, W3C 2025, sections 5
/// and 11).
fn png_frame(bytes: &[u8]) -> Frame {
    let mut frame = Frame::default();
    let mut at = PNG_MARK.len();
    loop {
        let Some(&[a, b, c, d, ref kind @ ..]) = bytes.get(at..).and_then(|rest| rest.first_chunk::<8>())
        else {
            frame.cut = Some(bytes.len());
            return frame;
        };
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        let Some(data) = bytes.get(at + 8..).and_then(|rest| rest.get(..length + 4)) else {
            // A length beyond the format's limit is damage, which the decoder reports; more bytes would not help.
            frame.cut = (length <= i32::MAX as usize).then_some(bytes.len());
            return frame;
        };
        match kind {
            b"IEND" => return frame,
            b"CgBI" => frame.is_apple = true,
            b"acTL" => frame.is_animated = true,
            b"IHDR" if length >= 10 => (frame.depth, frame.is_palette) = (data[8], data[9] == 3),
            b"pHYs" if length == 9 => {
                let number = |at: usize| {
                    f64::from(u32::from_be_bytes([data[at], data[at + 1], data[at + 2], data[at + 3]]))
                };
                let (x, y) = (number(0), number(4));
                if x > 0.0 && y > 0.0 {
                    frame.pixel_aspect = Some(x / y);
                    frame.density = (data[8] == 1).then_some([x / 1e3, y / 1e3]);
                }
            }
            _ => {}
        }
        at += length + 12;
    }
}

/// Reads the headers of a BMP file (BITMAPFILEHEADER and BITMAPINFOHEADER, Microsoft, Windows GDI reference).
fn bmp_frame(bytes: &[u8]) -> Frame {
    let mut frame = Frame::default();
    let short = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    let parts = (|| Some((word(bytes, 2)? as usize, word(bytes, 10)? as usize, word(bytes, 14)?)))();
    let Some((declared, pixels_at, header)) = parts.filter(|_| bytes.len() >= 26) else {
        frame.cut = Some(bytes.len());
        return frame;
    };
    let mut needed = pixels_at;
    if header >= 40 {
        let fields = (|| Some((word(bytes, 18)?, word(bytes, 22)?, short(28)?, word(bytes, 30)?)))();
        let Some((width, height, depth, compression)) = fields else {
            frame.cut = Some(bytes.len());
            return frame;
        };
        frame.depth = if depth <= 8 { depth as u8 } else { 8 };
        frame.is_palette = depth <= 8;
        if let (Some(x), Some(y)) = (word(bytes, 38), word(bytes, 42))
            && x > 0
            && y > 0
            && x < 1 << 31
            && y < 1 << 31
        {
            frame.density = Some([f64::from(x) / 1e3, f64::from(y) / 1e3]);
            frame.pixel_aspect = Some(f64::from(x) / f64::from(y));
        }
        // Some programs write a wrong file size, so the file is treated as complete if all rows are there.
        if matches!(compression, 0 | 3 | 6) {
            let row = (u64::from(width) * u64::from(depth)).div_ceil(32) * 4;
            let rows = u64::from((height as i32).unsigned_abs());
            needed = usize::try_from(row * rows).map_or(usize::MAX, |rows| rows.saturating_add(pixels_at));
        } else {
            needed = declared;
        }
    }
    frame.cut = (bytes.len() < needed).then_some(bytes.len());
    frame
}

/// The density in pixels per inch.
pub(super) fn dots_per_inch(density: [f64; 2]) -> [f64; 2] {
    density.map(|per_mm| per_mm * INCH)
}
