//! glTF 2 and GLB: container, buffers and JSON. [`scene`] walks the scene, [`accessor`] reads the numbers.
//!
//! The format crate splits the container, parses the JSON and reads the numbers. Its validation is not used: it panics
//! on missing accessors and refuses files that lack things not needed here (textures, bounds of positions). Instead,
//! each reference is checked just before the crate follows it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io;

use ::gltf::binary::Error as GlbError;
use ::gltf::json::{Root, buffer, deserialize};
use ::gltf::{Document, Error as GltfError, Glb};

use crate::formats::Pace;
use crate::reason::Notice;

use super::text::first_bytes;
use super::{Buffer, MeshFormat, MeshReadError, NamedFiles, RawPart};

mod accessor;
mod draco;
mod meshopt;
mod pose;
mod repair;
mod scene;

/// Length of the header of a GLB file, bytes.
const GLB_HEADER: usize = 12;
/// Length of the header of each chunk, bytes.
const CHUNK_HEADER: usize = 8;

/// Reads a part from a glTF or GLB file; `siblings` are the contents of files beside it, by file name.
pub(super) fn read(
    bytes: &[u8],
    format: MeshFormat,
    pace: Pace,
    siblings: &BTreeMap<String, Vec<u8>>,
) -> Result<RawPart, MeshReadError> {
    let container = Container::split(bytes, format)?;
    let (mut root, notices) = parse(&container.json)?;
    let mut buffers = load_buffers(&root.buffers, container.binary, siblings)?;
    meshopt::decode_views(&mut root, &mut buffers)?;
    let document = Document::from_json_without_validation(root);
    let mut part = scene::read(&document, &buffers, format, pace)?;
    part.notices.extend(notices);
    if container.trailing > 0 {
        let message = format!("{} bytes after the end of the GLB data were skipped", container.trailing);
        part.notices.push(Notice::warning("glb-trailing-bytes", message));
    }
    Ok(part)
}

/// Whether a node is a marking frame.
pub(super) fn has_frame(bytes: &[u8], format: MeshFormat) -> bool {
    let document = Container::split(bytes, format).and_then(|container| parse(&container.json));
    document.is_ok_and(|(root, _)| root.nodes.iter().any(scene::is_frame))
}

/// The files beside the part that contain its buffers and its textures.
pub(super) fn named_files(bytes: &[u8], format: MeshFormat) -> Result<NamedFiles, MeshReadError> {
    let (root, _) = parse(&Container::split(bytes, format)?.json)?;
    let mut buffers: Vec<Buffer> = Vec::new();
    for buffer in &root.buffers {
        let Some(uri) = buffer.uri.as_deref().filter(|uri| !uri.starts_with("data:")) else { continue };
        let (name, bytes) = (sibling_name(uri)?, buffer.byte_length.0);
        match buffers.iter_mut().find(|known| known.name == name) {
            Some(known) => known.bytes = known.bytes.max(bytes),
            None => buffers.push(Buffer { name, bytes }),
        }
    }
    let images = root.images.iter().filter_map(|image| image.uri.as_deref());
    let images = images.filter(|uri| !uri.starts_with("data:"));
    Ok(NamedFiles { buffers, textures: images.filter_map(|uri| sibling_name(uri).ok()).collect() })
}

/// The two chunks of a GLB file, or the JSON alone.
struct Container<'a> {
    json: Cow<'a, [u8]>,
    binary: Option<Cow<'a, [u8]>>,
    trailing: usize,
}

impl<'a> Container<'a> {
    fn split(bytes: &'a [u8], format: MeshFormat) -> Result<Self, MeshReadError> {
        if !bytes.starts_with(b"glTF") {
            let json = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
            return match json.trim_ascii_start().first() {
                Some(b'{') => Ok(Self { json: json.into(), binary: None, trailing: 0 }),
                _ => Err(MeshReadError::NotThisFormat { format, found: first_bytes(bytes) }),
            };
        }
        let cut = |declared: usize, actual: usize| MeshReadError::Truncated {
            format: MeshFormat::Glb,
            declared: declared as u64,
            actual: actual as u64,
        };
        // The crate subtracts the header from the length unchecked, and does not return what follows the end.
        let version = word(bytes, 4).ok_or(cut(GLB_HEADER, bytes.len()))?;
        let length = word(bytes, 8).ok_or(cut(GLB_HEADER, bytes.len()))? as usize;
        if version != 2 {
            return Err(MeshReadError::Version { version: version.to_string() });
        }
        let file = bytes.get(..length).ok_or(cut(length, bytes.len()))?;
        if length < GLB_HEADER + CHUNK_HEADER {
            return Err(cut(GLB_HEADER + CHUNK_HEADER, length));
        }
        let glb = Glb::from_slice(file).map_err(|error| match error {
            GltfError::Binary(GlbError::ChunkLength { length: declared, length_read, .. }) => {
                cut(length - length_read + declared as usize, length)
            }
            GltfError::Binary(GlbError::Io(_)) => cut(length + CHUNK_HEADER, length),
            // If a chunk other than BIN follows the JSON, bytes before it were lost or inserted.
            _ if file[GLB_HEADER + 4..].starts_with(b"JSON") => {
                let json_length = word(file, GLB_HEADER).unwrap_or(0) as usize;
                cut(length, GLB_HEADER + CHUNK_HEADER + json_length)
            }
            _ => MeshReadError::NotThisFormat {
                format: MeshFormat::Glb,
                found: "a GLB header without a JSON chunk".into(),
            },
        })?;
        Ok(Self { json: glb.json, binary: glb.bin, trailing: bytes.len() - length })
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

/// The document, and the notices about it.
fn parse(json: &[u8]) -> Result<(Root, Vec<Notice>), MeshReadError> {
    // Names in a code page other than UTF-8 come out damaged, which is harmless.
    let text = String::from_utf8_lossy(json);
    let parsed = deserialize::from_str(&text).map_err(|error| MeshReadError::BadJson {
        line: error.line() as u64,
        column: error.column() as u64,
        message: error.to_string(),
    });
    let (mut root, mut notices): (Root, Vec<Notice>) = match parsed {
        Ok(root) => (root, Vec::new()),
        Err(error) => repair::reread(&text, error)?,
    };
    if !root.asset.version.starts_with("2.") {
        return Err(MeshReadError::Version { version: root.asset.version });
    }
    let is_read = |name: &str| {
        name == accessor::QUANTIZATION
            || name == draco::NAME
            || name == pose::INSTANCING
            || name == scene::VISIBILITY
            || meshopt::NAMES.contains(&name)
            || repair::is_looks_only(name)
    };
    if let Some(name) = root.extensions_required.iter().find(|name| !is_read(name)) {
        return Err(MeshReadError::UnsupportedExtension { name: name.clone() });
    }
    notices.extend(repair::looks_notice(&root.extensions_required));
    // Sparse data without elements have no effect, and the crate would subtract from their count.
    for accessor in &mut root.accessors {
        accessor.sparse = accessor.sparse.take().filter(|sparse| sparse.count.0 > 0);
    }
    Ok((root, notices))
}

fn load_buffers<'a>(
    buffers: &[buffer::Buffer],
    binary: Option<Cow<'a, [u8]>>,
    siblings: &'a BTreeMap<String, Vec<u8>>,
) -> Result<Vec<Cow<'a, [u8]>>, MeshReadError> {
    let load = |(number, buffer): (usize, &buffer::Buffer)| {
        let (name, data) = match buffer.uri.as_deref() {
            None if meshopt::is_fallback(buffer.extensions.as_ref().map(|extensions| &extensions.others)) => {
                return Ok(Cow::Borrowed(&[][..]));
            }
            None => {
                let name = format!("{number} inside the GLB file");
                let data = binary.clone().ok_or(MeshReadError::BufferShort {
                    name: name.clone(),
                    declared: buffer.byte_length.0,
                    actual: 0,
                })?;
                (name, data)
            }
            Some(uri) if uri.starts_with("data:") => {
                let encoded = uri.split_once(";base64,").map(|(_, encoded)| encoded);
                let data = encoded.and_then(decode_base64);
                (format!("{number}"), Cow::Owned(data.ok_or(MeshReadError::BadDataUri { buffer: number })?))
            }
            Some(uri) => {
                let name = sibling_name(uri)?;
                let Some(data) = siblings.get(&name) else {
                    return Err(MeshReadError::BufferMissing { name, kind: io::ErrorKind::NotFound });
                };
                (format!("\"{name}\""), Cow::Borrowed(&**data))
            }
        };
        let (declared, actual) = (buffer.byte_length.0, data.len() as u64);
        if actual < declared {
            return Err(MeshReadError::BufferShort { name, declared, actual });
        }
        Ok(data)
    };
    buffers.iter().enumerate().map(load).collect()
}

/// The file name that a URI names.
///
/// # Errors
/// [`MeshReadError::BufferName`] unless it is a plain file name in the part's folder.
fn sibling_name(uri: &str) -> Result<String, MeshReadError> {
    let name = decode_percent(uri);
    let plain = name.strip_prefix("./").unwrap_or(&name);
    let is_invalid = plain.is_empty()
        || plain == "."
        || plain == ".."
        || plain.chars().any(|letter| matches!(letter, '/' | '\\' | ':') || letter.is_control());
    if is_invalid { Err(MeshReadError::BufferName { name }) } else { Ok(plain.into()) }
}

fn decode_percent(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let digit = |offset: usize| bytes.get(at + offset).and_then(|&byte| (byte as char).to_digit(16));
        match (bytes[at], digit(1), digit(2)) {
            (b'%', Some(high), Some(low)) => {
                decoded.push((high * 16 + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    // A name with a literal % that only looks encoded is kept as written if the decoded bytes are not UTF-8.
    String::from_utf8(decoded).unwrap_or_else(|_| uri.into())
}

fn decode_base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut count) = (0u32, 0);
    for letter in text.bytes() {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests;
