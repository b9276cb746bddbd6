//! Decodes buffer views that are compressed with `EXT_meshopt_compression` (Khronos, 2021; its appendices A and B specify
//! the bitstreams and filters exactly), also in the later version 1 of attribute streams.
//!
//! Every read is checked against the end of the data, and what a view may claim is limited before memory is reserved.

use std::borrow::Cow;

use ::gltf::json::{Index, Root, validation::USize64};
use serde_json::Value;

use crate::formats::mesh::{MAX_TRIANGLES, MeshReadError, at_most};

/// The names of the extension.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Largest number of vertices in a block of attributes.
const MAX_BLOCK: usize = 256;
/// Bytes of a block of attributes.
const BLOCK_BYTES: usize = 8192;
/// Number of values that are coded together.
const GROUP: usize = 16;
/// How many times longer than its compressed data a buffer view may be, beyond [`FREE_BYTES`].
const MAX_RATIO: u64 = 1000;
/// Length that every view may have, bytes.
const FREE_BYTES: u64 = 1 << 20;
/// Largest length of all views together, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Whether a buffer only stands in for programs without this extension; its data may be missing.
pub(super) fn is_fallback(extensions: Option<&serde_json::Map<String, Value>>) -> bool {
    NAMES.iter().filter_map(|name| extensions?.get(*name)).any(|extension| extension["fallback"] == true)
}

/// Replaces every compressed buffer view by one of decoded data in a buffer of its own.
pub(super) fn decode_views(root: &mut Root, buffers: &mut Vec<Cow<'_, [u8]>>) -> Result<(), MeshReadError> {
    let mut left = MAX_BYTES;
    for number in 0..root.buffer_views.len() {
        let view = &root.buffer_views[number];
        let extensions = view.extensions.as_ref();
        let named = NAMES.iter().find_map(|name| extensions?.others.get(*name));
        let Some(extension) = named else { continue };
        let problem = |problem: &str| MeshReadError::Compressed {
            item: format!("buffer view {number}"),
            problem: problem.into(),
        };
        let stream = Stream::of(extension).ok_or_else(|| problem("its description is not valid"))?;
        let Some(data) = stream.data(buffers) else { return Err(problem("its data are not in the buffer")) };
        let limit = FREE_BYTES.saturating_add((data.len() as u64).saturating_mul(MAX_RATIO));
        let length = (stream.count as u64).saturating_mul(stream.stride as u64);
        at_most("elements in one buffer view", stream.count, 3 * MAX_TRIANGLES)?;
        if length > limit {
            return Err(problem("it is over 1000 times as long as its compressed data"));
        }
        // Any number of views can share the same compressed data.
        left = left.checked_sub(length).ok_or_else(|| problem("all views together are longer than 1 GB"))?;
        let decoded = stream.decode(data).ok_or_else(|| problem("its data are damaged"))?;
        let view = &mut root.buffer_views[number];
        view.buffer = Index::new(buffers.len() as u32);
        view.byte_offset = None;
        view.byte_length = USize64(decoded.len() as u64);
        root.buffers.push(::gltf::json::Buffer {
            byte_length: USize64(decoded.len() as u64),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        buffers.push(Cow::Owned(decoded));
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, PartialEq)]
enum Filter {
    None,
    Octahedral,
    Exponential,
}

/// A compressed view as the extension describes it.
struct Stream {
    buffer: usize,
    offset: usize,
    length: usize,
    stride: usize,
    count: usize,
    mode: Mode,
    filter: Filter,
}

impl Stream {
    fn of(extension: &Value) -> Option<Self> {
        let number = |name: &str| extension[name].as_u64().and_then(|number| usize::try_from(number).ok());
        let (stride, count) = (number("byteStride")?, number("count")?);
        let (mode, is_valid) = match extension["mode"].as_str()? {
            "ATTRIBUTES" => (Mode::Attributes, stride % 4 == 0 && (4..=256).contains(&stride)),
            "TRIANGLES" => (Mode::Triangles, matches!(stride, 2 | 4) && count % 3 == 0),
            "INDICES" => (Mode::Indices, matches!(stride, 2 | 4)),
            _ => return None,
        };
        let filter = match extension["filter"].as_str().unwrap_or("NONE") {
            "OCTAHEDRAL" if matches!(stride, 4 | 8) => Filter::Octahedral,
            "EXPONENTIAL" => Filter::Exponential,
            // Rotations and colours are not read.
            "NONE" | "QUATERNION" | "COLOR" => Filter::None,
            _ => return None,
        };
        let buffer = number("buffer")?;
        let offset = extension.get("byteOffset").map_or(Some(0), |_| number("byteOffset"))?;
        is_valid.then_some(Self {
            buffer,
            offset,
            length: number("byteLength")?,
            stride,
            count,
            mode,
            filter,
        })
    }

    fn data<'b>(&self, buffers: &'b [Cow<'_, [u8]>]) -> Option<&'b [u8]> {
        buffers.get(self.buffer)?.get(self.offset..)?.get(..self.length)
    }

    fn decode(&self, data: &[u8]) -> Option<Vec<u8>> {
        let index_bytes = |indices: Vec<u32>| {
            let narrow = |index: u32| index.to_le_bytes().into_iter().take(self.stride);
            indices.into_iter().flat_map(narrow).collect()
        };
        let mut decoded = match self.mode {
            Mode::Attributes => attributes(data, self.count, self.stride)?,
            Mode::Triangles => index_bytes(triangles(data, self.count)?),
            Mode::Indices => index_bytes(indices(data, self.count)?),
        };
        match self.filter {
            Filter::None => {}
            Filter::Octahedral => unfold_normals(&mut decoded, self.stride),
            Filter::Exponential => scale_exponents(&mut decoded),
        }
        Some(decoded)
    }
}

/// Takes bytes from the start of the data.
fn take<'d>(data: &mut &'d [u8], count: usize) -> Option<&'d [u8]> {
    let (taken, rest) = data.split_at_checked(count)?;
    *data = rest;
    Some(taken)
}

/// Mode 0: elements of `stride` bytes, each byte coded by its difference from the element before.
fn attributes(data: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let (&header, mut data) = data.split_first()?;
    let version = header & 0x0f;
    if header & 0xf0 != 0xa0 || version > 1 {
        return None;
    }
    let channels = if version == 0 { 0 } else { stride / 4 };
    let tail_length = stride + channels;
    let padded = tail_length.max(if version == 0 { 32 } else { 24 });
    let body = data.len().checked_sub(padded)?;
    let tail = &data[data.len() - tail_length..];
    let (mut last, channels) = (tail[..stride].to_vec(), &tail[stride..]);
    let block = (BLOCK_BYTES / stride / GROUP * GROUP).min(MAX_BLOCK);
    let end = data.len();
    let mut decoded = vec![0; count * stride];
    let mut planes = [const { [0u8; MAX_BLOCK] }; 4];
    for elements in decoded.chunks_mut(block * stride) {
        let length = elements.len() / stride;
        let control = take(&mut data, channels.len())?;
        for first in (0..stride).step_by(4) {
            for (byte, plane) in planes.iter_mut().enumerate() {
                let coding = if version == 0 { None } else { Some(control[first / 4] >> (2 * byte) & 3) };
                match coding {
                    None => groups(&mut data, &mut plane[..], length, [0, 2, 4, 8])?,
                    Some(0) => groups(&mut data, &mut plane[..], length, [0, 1, 2, 4])?,
                    Some(1) => groups(&mut data, &mut plane[..], length, [1, 2, 4, 8])?,
                    Some(2) => plane.fill(0),
                    Some(_) => plane[..length].copy_from_slice(take(&mut data, length)?),
                }
            }
            let channel = channels.get(first / 4).copied().unwrap_or(0);
            undo_differences(&planes, elements, &mut last, first, stride, channel)?;
        }
        let start = (length - 1) * stride;
        last.copy_from_slice(&elements[start..start + stride]);
    }
    (end - data.len() == body).then_some(decoded)
}

/// The bytes of one place in all elements of a block: groups of 16, each with its own number of bits.
fn groups(data: &mut &[u8], plane: &mut [u8], length: usize, bits: [u32; 4]) -> Option<()> {
    let header = take(data, length.div_ceil(GROUP).div_ceil(4))?;
    for (number, group) in plane[..length.next_multiple_of(GROUP)].chunks_mut(GROUP).enumerate() {
        let bits = bits[usize::from(header[number / 4] >> (2 * (number % 4)) & 3)];
        match bits {
            0 => group.fill(0),
            8 => group.copy_from_slice(take(data, GROUP)?),
            _ => {
                let packed = take(data, GROUP * bits as usize / 8)?;
                let largest = (1u8 << bits) - 1;
                let per_byte = 8 / bits as usize;
                for (at, value) in group.iter_mut().enumerate() {
                    let place = (at % per_byte) as u32;
                    // Single bits begin at the lowest, wider values at the highest.
                    let shift = if bits == 1 { place } else { 8 - bits * (place + 1) };
                    let small = packed[at / per_byte] >> shift & largest;
                    *value = if small == largest { take(data, 1)?[0] } else { small };
                }
            }
        }
    }
    Some(())
}

/// Adds the differences of four bytes of every element to those of the element before.
fn undo_differences(
    planes: &[[u8; MAX_BLOCK]; 4],
    elements: &mut [u8],
    last: &mut [u8],
    first: usize,
    stride: usize,
    channel: u8,
) -> Option<()> {
    let mut before = [last[first], last[first + 1], last[first + 2], last[first + 3]];
    for (number, element) in elements.chunks_mut(stride).enumerate() {
        let coded = [planes[0][number], planes[1][number], planes[2][number], planes[3][number]];
        before = match channel & 3 {
            0 => std::array::from_fn(|at| {
                let value = coded[at];
                ((value >> 1) ^ (value & 1).wrapping_neg()).wrapping_add(before[at])
            }),
            1 => {
                let half = |at: usize| {
                    let value = u16::from_le_bytes([coded[at], coded[at + 1]]);
                    let previous = u16::from_le_bytes([before[at], before[at + 1]]);
                    ((value >> 1) ^ (value & 1).wrapping_neg()).wrapping_add(previous).to_le_bytes()
                };
                let ([a, b], [c, d]) = (half(0), half(2));
                [a, b, c, d]
            }
            2 => {
                let turned = u32::from_le_bytes(coded).rotate_left((32 - u32::from(channel >> 4)) & 31);
                (turned ^ u32::from_le_bytes(before)).to_le_bytes()
            }
            _ => return None,
        };
        element[first..first + 4].copy_from_slice(&before);
    }
    Some(())
}

/// A whole number of up to 32 bits, seven in each byte.
fn variable(data: &mut &[u8]) -> Option<u32> {
    let mut value = 0u32;
    for shift in (0..35).step_by(7) {
        let byte = take(data, 1)?[0];
        value |= u32::from(byte & 127).checked_shl(shift).unwrap_or(0);
        if byte < 128 {
            break;
        }
    }
    Some(value)
}

/// A whole number that follows the one before by a signed difference.
fn next_index(data: &mut &[u8], before: u32) -> Option<u32> {
    let value = variable(data)?;
    Some(before.wrapping_add((value >> 1) ^ (value & 1).wrapping_neg()))
}

/// The last 16 entries.
struct Recent<T> {
    entries: [T; 16],
    next: usize,
}

impl<T: Copy> Recent<T> {
    fn push(&mut self, entry: T) {
        self.entries[self.next] = entry;
        self.next = (self.next + 1) & 15;
    }

    /// The entry that was pushed `back` before the last.
    fn back(&self, back: u8) -> T {
        self.entries[(self.next.wrapping_sub(1 + usize::from(back))) & 15]
    }
}

/// Mode 1: triangles that share edges and corners with those before.
fn triangles(data: &[u8], count: usize) -> Option<Vec<u32>> {
    const TABLE: usize = 16;
    let (&header, data) = data.split_first()?;
    let version = header & 0x0f;
    if header & 0xf0 != 0xe0 || version > 1 {
        return None;
    }
    let (codes, data) = data.split_at_checked(count / 3)?;
    let (mut data, table) = data.split_at_checked(data.len().checked_sub(TABLE)?)?;
    let last_recent = if version >= 1 { 13 } else { 15 };
    let mut edges = Recent { entries: [[u32::MAX; 2]; 16], next: 0 };
    let mut corners = Recent { entries: [u32::MAX; 16], next: 0 };
    let (mut next, mut last) = (0u32, 0u32);
    let mut decoded = Vec::with_capacity(count);
    for &code in codes {
        let triangle = if code < 0xf0 {
            let [a, b] = edges.back(code >> 4);
            let third = code & 15;
            let c = if third == 0 {
                let c = next;
                next = next.wrapping_add(1);
                corners.push(c);
                c
            } else if third < last_recent {
                corners.back(third)
            } else {
                last = match third {
                    13 => last.wrapping_sub(1),
                    14 => last.wrapping_add(1),
                    _ => next_index(&mut data, last)?,
                };
                corners.push(last);
                last
            };
            edges.push([c, b]);
            edges.push([a, c]);
            [a, b, c]
        } else {
            let (first, pair) = if code < 0xfe {
                (0, table[usize::from(code & 15)])
            } else {
                let pair = take(&mut data, 1)?[0];
                if pair == 0 {
                    next = 0;
                }
                (if code == 0xfe { 0 } else { 15 }, pair)
            };
            let mut new = || {
                next = next.wrapping_add(1);
                next.wrapping_sub(1)
            };
            // The corners that were used before are counted back from those before this triangle.
            let mut corner = |code: u8| match code {
                0 => new(),
                15 => 0,
                _ => corners.back(code - 1),
            };
            let mut found = [corner(first), corner(pair >> 4), corner(pair & 15)];
            let kinds = [first, pair >> 4, pair & 15];
            for (corner, kind) in found.iter_mut().zip(kinds) {
                if kind == 15 {
                    last = next_index(&mut data, last)?;
                    *corner = last;
                }
            }
            for (corner, kind) in found.into_iter().zip(kinds) {
                if matches!(kind, 0 | 15) {
                    corners.push(corner);
                }
            }
            let [a, b, c] = found;
            edges.push([b, a]);
            edges.push([c, b]);
            edges.push([a, c]);
            found
        };
        decoded.extend(triangle);
    }
    data.is_empty().then_some(decoded)
}

/// Mode 2: whole numbers that follow one of two before them.
fn indices(data: &[u8], count: usize) -> Option<Vec<u32>> {
    const TAIL: usize = 4;
    let (&header, data) = data.split_first()?;
    if header & 0xf0 != 0xd0 || header & 0x0f > 1 {
        return None;
    }
    let mut data = &data[..data.len().checked_sub(TAIL)?];
    if data.len() < count {
        return None;
    }
    let mut last = [0u32; 2];
    let mut decoded = Vec::with_capacity(count);
    for _ in 0..count {
        let value = variable(&mut data)?;
        let (which, value) = ((value & 1) as usize, value >> 1);
        last[which] = last[which].wrapping_add((value >> 1) ^ (value & 1).wrapping_neg());
        decoded.push(last[which]);
    }
    data.is_empty().then_some(decoded)
}

/// Turns octahedral coordinates into unit vectors of signed bytes or 16-bit numbers.
fn unfold_normals(data: &mut [u8], stride: usize) {
    let wide = stride == 8;
    let largest = if wide { 32767.0f32 } else { 127.0 };
    for element in data.chunks_exact_mut(stride) {
        let read = |at: usize| match wide {
            true => f32::from(i16::from_le_bytes([element[2 * at], element[2 * at + 1]])),
            false => f32::from(element[at] as i8),
        };
        let (mut x, mut y) = (read(0), read(1));
        let z = read(2) - x.abs() - y.abs();
        let fold = z.min(0.0);
        x += if x >= 0.0 { fold } else { -fold };
        y += if y >= 0.0 { fold } else { -fold };
        let scale = largest / (x * x + y * y + z * z).sqrt();
        for (at, value) in [x, y, z].into_iter().enumerate() {
            let rounded = value * scale + 0.5f32.copysign(value);
            match wide {
                true => element[2 * at..2 * at + 2].copy_from_slice(&(rounded as i16).to_le_bytes()),
                false => element[at] = rounded as i8 as u8,
            }
        }
    }
}

/// Turns mantissas of 24 bits with exponents of 8 bits into floats.
fn scale_exponents(data: &mut [u8]) {
    for element in data.chunks_exact_mut(4) {
        let coded = i32::from_le_bytes([element[0], element[1], element[2], element[3]]);
        let (exponent, mantissa) = (coded >> 24, coded << 8 >> 8);
        let value = 2f64.powi(exponent) * f64::from(mantissa);
        element.copy_from_slice(&(value as f32).to_le_bytes());
    }
}

#[cfg(test)]
mod tests;
