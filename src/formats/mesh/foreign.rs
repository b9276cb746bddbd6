//! Refuses files of other formats under the name of a part, recognised by their first bytes.

use super::package::Package;
use super::text::{number, without_mark, words};
use super::{Content, MeshFormat, MeshReadError};

/// Length of the beginning of a text by which it is recognised, bytes.
const HEAD: usize = 2048;
/// Number of its lines by which it is recognised.
const LINES: usize = 16;

/// Refuses a file of another known format than `format`.
pub(super) fn check(bytes: &[u8], format: MeshFormat) -> Result<(), MeshReadError> {
    // The first 80 bytes of a binary STL are free text.
    if format == MeshFormat::Stl && super::stl::has_length_of_binary(bytes) {
        return Ok(());
    }
    match content(bytes).filter(|found| !found.is(format)) {
        // A 3MF file without its directory is cut off.
        Some(Content::Zip) if format == MeshFormat::ThreeMf && Package::open(bytes).is_err() => Ok(()),
        Some(found) => Err(MeshReadError::OtherFormat { format, found }),
        None => Ok(()),
    }
}

/// The known format of the bytes.
fn content(bytes: &[u8]) -> Option<Content> {
    let starts: [(&[u8], Content); 15] = [
        (b"\x1f\x8b\x08", Content::Gzip),
        (b"7z\xbc\xaf\x27\x1c", Content::Archive),
        (b"Rar!\x1a\x07", Content::Archive),
        (b"%PDF-", Content::Pdf),
        (b"\x89PNG\r\n", Content::Picture),
        (b"\xff\xd8\xff", Content::Picture),
        (b"BLENDER", Content::Blend),
        (b"Kaydara FBX Binary", Content::Fbx),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", Content::Compound),
        (b"ply\n", Content::Ply),
        (b"ply\r", Content::Ply),
        (b"ISO-10303-21;", Content::Step),
        (b"<!DOCTYPE html", Content::Html),
        (b"<!doctype html", Content::Html),
        (b"AutoCAD Binary DXF", Content::Dxf),
    ];
    if bytes.starts_with(b"PK\x03\x04") {
        return Some(content_of_zip(bytes));
    }
    let text = without_mark(bytes).trim_ascii_start();
    let known = starts.iter().find(|(start, _)| bytes.starts_with(start) || text.starts_with(start));
    known.map(|(_, content)| *content).or_else(|| content_of_text(text)).or_else(|| mesh_of_no_mark(bytes))
}

/// STL and OBJ files have no mark at their beginning: a binary STL file is known by its length, the others by their lines.
fn mesh_of_no_mark(bytes: &[u8]) -> Option<Content> {
    if super::stl::has_facets_of_binary(bytes) {
        return Some(Content::Stl);
    }
    let text = without_mark(bytes);
    let lines = super::text::lines(&text[..text.len().min(HEAD)]).map(|(_, line)| line);
    let mut lines = lines.filter(|line| !line.is_empty() && !line.starts_with(b"#")).take(LINES);
    let keyword = |line: &[u8]| words(line).next().unwrap_or_default().to_ascii_lowercase();
    let first = lines.next()?;
    if keyword(first) == b"solid" {
        return lines.next().filter(|line| keyword(line) == b"facet").map(|_| Content::Stl);
    }
    // A corner follows some statements about groups and materials.
    for line in std::iter::once(first).chain(lines) {
        match &*keyword(line) {
            b"v" => return (words(line).skip(1).filter_map(number).count() >= 3).then_some(Content::Obj),
            b"o" | b"g" | b"s" | b"mtllib" | b"usemtl" => {}
            _ => return None,
        }
    }
    None
}

fn content_of_zip(bytes: &[u8]) -> Content {
    let Ok(package) = Package::open(bytes) else { return Content::Zip };
    let has = |ending: &str| package.names().any(|name| name.ends_with(ending));
    match () {
        () if has(".amf") => Content::Amf,
        () if has(".model") => Content::ThreeMf,
        () if has("document.xml") && has("guidocument.xml") => Content::FreeCad,
        () => Content::Zip,
    }
}

fn content_of_text(text: &[u8]) -> Option<Content> {
    if text.starts_with(b"<") {
        let head = String::from_utf8_lossy(&text[..text.len().min(HEAD)]);
        let tags = [
            ("<svg", Content::Svg),
            ("<html", Content::Html),
            ("<COLLADA", Content::Collada),
            ("<amf", Content::Amf),
        ];
        return tags.iter().find(|(tag, _)| head.contains(tag)).map(|(_, content)| *content);
    }
    let mut lines = super::text::lines(&text[..text.len().min(64)]).map(|(_, line)| line);
    (lines.next() == Some(b"0") && lines.next() == Some(b"SECTION")).then_some(Content::Dxf)
}
