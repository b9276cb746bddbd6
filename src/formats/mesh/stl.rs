//! STL, text and binary (3D Systems, StereoLithography interface specification, 1989).
//!
//! The format is so simple that this reader is shorter than the checks that a crate would need. A file is binary if its
//! length matches its number of facets exactly, even if it begins with `solid`, as many binary files do. Vertices at
//! exactly the same position are welded. The normals are not read: they are only those of the facets.

use nalgebra::Point3;

use super::clues::{Clues, stated_unit_in_name};
use super::error::{EmptyCause, VertexPlace};
use super::text::{
    bad_line, beginning, first_bytes, last_line, lines, no_number, number, without_mark, words,
};
use super::{MAX_TRIANGLES, MeshFormat, MeshReadError, NormalsFound, RawPart, at_most, normals};
use crate::reason::Notice;

const HEADER: usize = 80;
/// Header and count.
const PREAMBLE: usize = HEADER + 4;
/// Normal, three corners, and two bytes of attributes.
const FACET: usize = 50;
/// Number of facets that distinguish a damaged file from one of another format.
const FIRST_FACETS: usize = 16;

/// Reads a part from an STL file.
pub(super) fn read(bytes: &[u8]) -> Result<RawPart, MeshReadError> {
    let (positions, mut part) = if is_text(bytes) { read_text(bytes)? } else { read_binary(bytes)? };
    if positions.is_empty() {
        return Err(MeshReadError::NoTriangles { cause: EmptyCause::Nothing });
    }
    let corners: Vec<[u32; 3]> =
        (0..positions.len() as u32 / 3).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
    (part.positions, part.triangles) = normals::weld(&positions, &corners);
    part.normals_found = NormalsFound::FacetsOnly;
    Ok(part)
}

/// Checks whether all facets are there.
pub(super) fn is_whole(bytes: &[u8]) -> Result<(), MeshReadError> {
    if !is_text(bytes) {
        return binary_facets(bytes).map(|_| ());
    }
    let (line, last, _) = last_line(bytes);
    let last = statements(last).next_back().unwrap_or_default();
    let ends = words(last).next().is_some_and(|word| word.eq_ignore_ascii_case(b"endsolid"));
    if ends { Ok(()) } else { Err(MeshReadError::CutLine { line, text: beginning(last) }) }
}

/// Whether the file has exactly the length that a binary file states.
pub(super) fn has_length_of_binary(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|count| bytes.len() as u64 == PREAMBLE as u64 + u64::from(count) * FACET as u64)
}

/// Whether it is also that of a file with facets, which no other format has by chance.
pub(super) fn has_facets_of_binary(bytes: &[u8]) -> bool {
    count(bytes).is_some_and(|count| count > 0) && has_length_of_binary(bytes)
}

fn is_text(bytes: &[u8]) -> bool {
    let text = without_mark(bytes).trim_ascii_start();
    let begins_with_solid = text.len() >= 5 && text[..5].eq_ignore_ascii_case(b"solid");
    begins_with_solid && !has_length_of_binary(bytes) && !text[..text.len().min(512)].contains(&0)
}

/// The number of facets that a binary file states.
fn count(bytes: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(HEADER..PREAMBLE)?.try_into().ok()?))
}

fn binary_facets(bytes: &[u8]) -> Result<&[[u8; FACET]], MeshReadError> {
    let is_word = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    if bytes[..bytes.len().min(PREAMBLE)].iter().all(is_word) {
        return Err(MeshReadError::NotThisFormat { format: MeshFormat::Stl, found: first_bytes(bytes) });
    }
    let count = count(bytes).unwrap_or(0);
    let declared = PREAMBLE as u64 + u64::from(count) * FACET as u64;
    if (bytes.len() as u64) < declared {
        if count as usize > MAX_TRIANGLES && !begins_with_facets(bytes) {
            return Err(MeshReadError::NotThisFormat { format: MeshFormat::Stl, found: first_bytes(bytes) });
        }
        return Err(MeshReadError::Truncated {
            format: MeshFormat::Stl,
            declared,
            actual: bytes.len() as u64,
        });
    }
    let (facets, rest) = bytes.get(PREAMBLE..).unwrap_or_default().as_chunks();
    // Data behind the facets could have this size by chance, but are rare; facets that are lost are scrap.
    if rest.is_empty() && count > 0 && facets.len() > count as usize {
        let follow = facets.len();
        let message = format!(
            "its header states {count} facets, but {follow} follow, so it is unclear where the part ends"
        );
        return Err(MeshReadError::Refused { format: MeshFormat::Stl, message });
    }
    // Programs that do not know the number of facets in advance leave it at 0.
    let count = if rest.is_empty() && count == 0 { facets.len() } else { count as usize };
    at_most("triangles", count, MAX_TRIANGLES)?;
    Ok(&facets[..count])
}

/// Whether numbers of facets follow the preamble: a normal that is missing or has the length 1, and corners that are finite. Data of
/// other files, read as such, are numbers of any size.
fn begins_with_facets(bytes: &[u8]) -> bool {
    let facets = bytes.get(PREAMBLE..).unwrap_or_default().as_chunks::<FACET>().0;
    facets.iter().take(FIRST_FACETS).all(|facet| {
        let values = facet[..48].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        let values: Vec<f32> = values.collect();
        let length = values[..3].iter().map(|value| value * value).sum::<f32>().sqrt();
        let has_normal = values[..3] == [0.0; 3] || (length - 1.0).abs() < 0.1;
        has_normal && values.iter().all(|value| value.is_finite())
    })
}

/// The corners of all facets, one after the other.
fn read_binary(bytes: &[u8]) -> Result<(Vec<Point3<f64>>, RawPart), MeshReadError> {
    let facets = binary_facets(bytes)?;
    let mut positions = Vec::with_capacity(facets.len() * 3);
    for (facet, bytes) in facets.iter().enumerate() {
        for corner in bytes[12..48].as_chunks::<12>().0 {
            let values = corner.as_chunks::<4>().0;
            let coordinate: [f64; 3] =
                std::array::from_fn(|axis| f64::from(f32::from_le_bytes(values[axis])));
            if !coordinate.iter().all(|value| value.is_finite()) {
                let vertex = VertexPlace::Numbered { what: "facet", number: facet };
                return Err(MeshReadError::NotFinite { vertex, coordinate });
            }
            positions.push(Point3::from(coordinate));
        }
    }
    let header = String::from_utf8_lossy(&bytes[..HEADER]);
    let header: String =
        header.chars().filter(|letter| !letter.is_control() && *letter != '\u{FFFD}').collect();
    let mut part = RawPart::new(clues(header.trim()));
    let rest = bytes.len() - PREAMBLE - facets.len() * FACET;
    if count(bytes) == Some(0) && !facets.is_empty() {
        let text = format!("the header states 0 facets; the {} facets that follow were read", facets.len());
        part.notices.push(Notice::warning("facet-count-zero", text));
    }
    if rest > 0 {
        let text = format!("{rest} bytes after the last facet were not read");
        part.notices.push(Notice::note("trailing-bytes", text));
    }
    Ok((positions, part))
}

fn clues(header: &str) -> Clues {
    let mut clues = Clues::new(MeshFormat::Stl, (!header.is_empty()).then(|| header.to_owned()));
    clues.stated_unit = stated_unit_in_name(header);
    clues
}

/// The keywords that begin a statement anywhere in a line.
const KEYWORDS: [&[u8]; 6] = [b"facet", b"outer", b"vertex", b"endloop", b"endfacet", b"endsolid"];

/// The statements of a line: usually one, but the format separates words by any white space. The name of a solid extends to the end of
/// its line or to `facet normal`.
fn statements(line: &[u8]) -> impl DoubleEndedIterator<Item = &[u8]> {
    let line = line.trim_ascii();
    // Each keyword has one of these letters, and no number has. All are looked at, which takes no branches.
    let first_ends = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    let may_have_others = line[first_ends..]
        .iter()
        .fold(false, |found, letter| found | matches!(letter | 0x20, b'd' | b'f' | b'u' | b'v'));
    let starts = if may_have_others { starts_of_others(line) } else { Vec::new() };
    (0..=starts.len()).map(move |index| {
        let start = index.checked_sub(1).map_or(0, |before| starts[before]);
        line[start..starts.get(index).copied().unwrap_or(line.len())].trim_ascii()
    })
}

/// Where statements begin behind the first one of a line.
fn starts_of_others(line: &[u8]) -> Vec<usize> {
    let is = |word: &[u8], keyword: &[u8]| word.eq_ignore_ascii_case(keyword);
    let (mut found, mut start, mut names) = (Vec::new(), 0, false);
    let mut words = words(line).peekable();
    while let Some(word) = words.next() {
        let at = word.as_ptr() as usize - line.as_ptr() as usize;
        let begins = match names {
            true => is(word, b"facet") && words.peek().is_some_and(|next| is(next, b"normal")),
            false => KEYWORDS.iter().any(|keyword| is(word, keyword)),
        };
        if at > 0 && begins {
            found.push(at);
            start = at;
        }
        if at == start {
            names = is(word, b"solid") || is(word, b"endsolid");
        }
    }
    found
}

fn read_text(bytes: &[u8]) -> Result<(Vec<Point3<f64>>, RawPart), MeshReadError> {
    is_whole(bytes)?;
    let (mut positions, mut in_facet, mut names) = (Vec::new(), 0, Vec::new());
    let lines = lines(without_mark(bytes));
    let all = lines.flat_map(|(line, text)| statements(text).map(move |text| (line, text)));
    for (line, text) in all {
        let mut words = words(text);
        let Some(keyword) = words.next() else { continue };
        match keyword.to_ascii_lowercase().as_slice() {
            b"vertex" => {
                let mut coordinate = [0.0; 3];
                for value in &mut coordinate {
                    let word =
                        words.next().ok_or_else(|| bad_line(line, text, "three numbers are needed"))?;
                    *value = number(word).ok_or_else(|| bad_line(line, text, no_number(word)))?;
                }
                if !coordinate.iter().all(|value| value.is_finite()) {
                    return Err(MeshReadError::NotFinite { vertex: VertexPlace::Obj { line }, coordinate });
                }
                in_facet += 1;
                positions.push(Point3::from(coordinate));
            }
            b"endfacet" => {
                if in_facet != 3 {
                    return Err(bad_line(line, text, "the facet above does not have three corners"));
                }
                in_facet = 0;
                at_most("triangles", positions.len() / 3, MAX_TRIANGLES)?;
            }
            b"solid" => names.push(String::from_utf8_lossy(&text[5..]).trim().to_owned()),
            b"facet" | b"outer" | b"endloop" => {}
            b"endsolid" if in_facet == 0 => {}
            b"endsolid" => return Err(bad_line(line, text, "the last facet has no endfacet")),
            _ => return Err(bad_line(line, text, "it does not begin with a keyword of the format")),
        }
    }
    names.retain(|name| !name.is_empty());
    let mut part = RawPart::new(clues(names.first().map_or("", String::as_str)));
    part.bodies = names;
    Ok((positions, part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::mesh::LengthUnit;

    const TETRAHEDRON: [[f32; 3]; 4] =
        [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];
    const FACETS: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    fn binary(header: &str) -> Vec<u8> {
        let mut bytes = format!("{header:80}").into_bytes();
        bytes.extend(4u32.to_le_bytes());
        for facet in FACETS {
            bytes.extend([0; 12]);
            facet.iter().flat_map(|&at| TETRAHEDRON[at]).for_each(|value| bytes.extend(value.to_le_bytes()));
            bytes.extend([7, 7]);
        }
        bytes
    }

    fn text() -> String {
        let corner = |at: usize| TETRAHEDRON[at].map(|value| value.to_string()).join(" ");
        let facet = |facet: &[usize; 3]| {
            let corners = facet.map(|at| format!("      vertex {}\n", corner(at))).concat();
            format!("  facet normal 0 0 0\n    outer loop\n{corners}    endloop\n  endfacet\n")
        };
        format!("solid Cone of mine\n{}endsolid Cone of mine\n", FACETS.iter().map(facet).collect::<String>())
    }

    #[test]
    fn text_and_binary_files_are_read_and_welded() {
        for (bytes, name) in
            [(binary("solid but binary"), "solid but binary"), (text().into_bytes(), "Cone of mine")]
        {
            let part = read(&bytes).unwrap();
            assert_eq!((part.positions.len(), part.triangles.len()), (4, 4));
            assert_eq!(part.clues.producer.as_deref(), Some(name));
            assert!(is_whole(&bytes).is_ok());
        }
        let capitals = text().to_uppercase().replace('\n', "\r\n");
        assert_eq!(read(capitals.as_bytes()).unwrap().triangles.len(), 4);
    }

    #[test]
    fn facets_that_the_header_does_not_count_are_never_lost() {
        let counted = |count: u32| {
            let mut bytes = binary("x");
            bytes[80..84].copy_from_slice(&count.to_le_bytes());
            bytes
        };
        let part = read(&counted(0)).unwrap();
        assert_eq!(part.triangles.len(), 4);
        assert_eq!(part.notices[0].code, "facet-count-zero");
        for count in 1..4 {
            let error = read(&counted(count)).map(|part| part.triangles.len()).unwrap_err();
            assert!(matches!(error, MeshReadError::Refused { .. }), "{error}");
            assert!(error.to_string().contains(&format!("{count} facets, but 4 follow")), "{error}");
        }
        assert!(read(&counted(4)).unwrap().notices.is_empty());
        let appended = read(&[&counted(4)[..], b"colours"].concat()).unwrap();
        assert_eq!((appended.triangles.len(), &*appended.notices[0].code), (4, "trailing-bytes"));
    }

    #[test]
    fn a_text_without_line_breaks_is_read() {
        let name = "outer vertex endsolid facet";
        let wrapped = text().replace("Cone of mine", name);
        let one_line = wrapped.split_whitespace().collect::<Vec<_>>().join(" ");
        for text in [wrapped, one_line.clone(), format!("{one_line}\n"), one_line.to_uppercase()] {
            let part = read(text.as_bytes()).unwrap();
            assert_eq!((part.positions.len(), part.triangles.len()), (4, 4), "{text}");
            assert!(part.bodies[0].eq_ignore_ascii_case(name), "{:?}", part.bodies);
            assert!(is_whole(text.as_bytes()).is_ok());
        }
        let cut = &one_line[..one_line.rfind(" endsolid").unwrap() - 20];
        assert!(matches!(read(cut.as_bytes()), Err(MeshReadError::CutLine { .. })));
    }

    #[test]
    fn the_name_of_a_solid_is_no_unit() {
        let named = |name: &str| text().replace("Cone of mine", name).into_bytes();
        for name in ["heating unit 2 inch pipe", "unit inch", "unit M", "Unit in metres"] {
            for bytes in [binary(name), named(name)] {
                assert_eq!(read(&bytes).unwrap().clues.stated_unit, None, "{name}");
            }
        }
        for name in ["UNITS=mm", "part, unit: mm"] {
            for bytes in [binary(name), named(name)] {
                assert_eq!(read(&bytes).unwrap().clues.stated_unit, Some(LengthUnit::Millimetre), "{name}");
            }
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let bytes = binary("x");
        assert!(matches!(
            read(&bytes[..200]),
            Err(MeshReadError::Truncated { declared: 284, actual: 200, .. })
        ));
        let mut false_count = bytes.clone();
        false_count[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read(&false_count), Err(MeshReadError::Truncated { .. })));
        // A mesh of ANSYS Fluent: a text, then numbers of eight bytes.
        let mut other =
            b"(1 \"meshio\")\n(2 3)\n(10 (0 1 80 0))\n(12 (0 1 fc 0))\n(3010 (1 1 80 1 3)(\n".to_vec();
        other.resize(77, b' ');
        (0..30).for_each(|number| other.extend(f64::to_le_bytes(-40.0 + 0.3 * f64::from(number))));
        assert!(count(&other).is_some_and(|count| count as usize > MAX_TRIANGLES));
        assert!(matches!(read(&other), Err(MeshReadError::NotThisFormat { .. })));
        let mut broken = bytes.clone();
        broken[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
        let place = VertexPlace::Numbered { what: "facet", number: 1 };
        assert!(matches!(read(&broken), Err(MeshReadError::NotFinite { vertex, .. }) if vertex == place));
        assert!(matches!(read(b"not a mesh"), Err(MeshReadError::NotThisFormat { .. })));
        assert!(matches!(read(b""), Err(MeshReadError::NotThisFormat { .. })));
        let text = text();
        assert!(matches!(read(&text.as_bytes()[..300]), Err(MeshReadError::CutLine { .. })));
        let wrong = text.replacen("vertex 10 0 0", "vertex 10 zero 0", 1);
        assert!(matches!(read(wrong.as_bytes()), Err(MeshReadError::BadLine { line: 6, .. })));
        assert!(matches!(read(b"solid\nendsolid\n"), Err(MeshReadError::NoTriangles { .. })));
    }
}
