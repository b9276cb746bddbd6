use super::*;

fn read(bytes: &[u8]) -> Result<RawPart, MeshReadError> {
    super::read(bytes, Pace::Any)
}

const TEXT: &str = "ply\nformat ascii 1.0\ncomment by hand, units: cm\nelement vertex 4\nproperty double z\n\
                    property list uchar int seen_by\nproperty float x\nproperty float y\nelement face 1\n\
                    property uchar red\nproperty list uchar int vertex_index\nend_header\n\
                    0 0 0 0\n0 2 7 8 1 0\n0 1 9 1 1\n0 0 0 1\n255 4 0 1 2 3\n";

fn problem(bytes: impl AsRef<[u8]>) -> MeshReadError {
    match read(bytes.as_ref()) {
        Err(error) => error,
        Ok(part) => panic!("read {} points", part.positions.len()),
    }
}

/// A file of float vertices in either byte order, whose header declares `claimed` vertices.
fn binary(order: &str, points: &[[f32; 3]], claimed: u64) -> Vec<u8> {
    let mut bytes = format!(
        "ply\r\nformat binary_{order}_endian 1.0\r\nelement vertex {claimed}\r\nproperty float x\r\nproperty float y\r\n\
         property float z\r\nend_header\r\n"
    )
    .into_bytes();
    for value in points.iter().flatten() {
        bytes.extend(if order == "big" { value.to_be_bytes() } else { value.to_le_bytes() });
    }
    bytes
}

#[test]
fn a_file_with_faces_becomes_a_mesh_of_triangles() {
    let part = read(TEXT.as_bytes()).unwrap();
    assert!(!part.is_scan && part.triangles.len() == 2);
    assert_eq!(part.positions[2], Point3::new(1.0, 1.0, 0.0));
    assert_eq!(part.clues.stated_unit, Some(super::super::LengthUnit::Centimetre));
    assert!(is_whole(TEXT.as_bytes()).is_ok());
    assert!(!is_scan(TEXT.as_bytes()) && !is_scan(b"ply"));
}

#[test]
fn both_byte_orders_give_the_same_points() {
    let points = [[1.5, -2.0, 3.25], [4.0, f32::NAN, 6.0]];
    for order in ["little", "big"] {
        let part = read(&binary(order, &points, 2)).unwrap();
        assert!(part.is_scan && is_scan(&binary(order, &points, 2)));
        assert_eq!(part.positions[0], Point3::new(1.5, -2.0, 3.25));
    }
}

#[test]
fn a_header_with_false_counts_is_refused_before_memory_is_reserved() {
    let error = problem(binary("little", &[[0.0; 3]], 4_000_000_000));
    assert!(matches!(error, MeshReadError::Truncated { declared: 48_000_000_109.., .. }), "{error}");
    let error = problem(TEXT.replace("vertex 4", "vertex 4000000000"));
    assert!(matches!(error, MeshReadError::CutShort { actual: 5, declared: 4_000_000_001, .. }), "{error}");
    let many = binary("little", &[], 0).len();
    let error = problem([binary("big", &[], 70_000_000), vec![0; 840_000_000 / 8]].concat());
    assert!(matches!(error, MeshReadError::Truncated { .. }) && many > 0, "{error}");
    // An element without properties takes no bytes and no time.
    let idle = TEXT.replace("element face", "element nothing 18446744073709551615\nelement face");
    assert!(read(idle.as_bytes()).is_ok());
    // A list that claims more values than the file has bytes.
    let list = TEXT.replace("255 4 0 1 2 3", "255 4000000000 0 1 2 3");
    assert!(matches!(problem(list), MeshReadError::Truncated { .. }));
}

#[test]
fn errors_are_reported_with_their_line() {
    for (from, to, line, words) in [
        ("format ascii", "format binary_middle_endian", 2, "binary_middle_endian is unknown"),
        ("property double z", "property double w", 12, "no property z"),
        ("property float x", "property text x", 7, "the type text is unknown"),
        ("vertex 4", "vertex four", 4, "not a whole number"),
        ("list uchar int vertex_index", "list float int vertex_index", 11, "not have an integer type"),
        ("element vertex", "colour vertex", 4, "unknown in a PLY header"),
        ("element vertex 4\n", "", 4, "before the first element"),
        ("vertex_index", "corners", 12, "no list property vertex_indices"),
    ] {
        let error = problem(TEXT.replace(from, to));
        let MeshReadError::BadHeader { line: at, problem, .. } = &error else { panic!("{to}: {error}") };
        assert!(*at == line && problem.contains(words), "{to}: line {at}, {problem}");
    }
    let error = problem(TEXT.replace("0 2 7 8 1 0", "0 2 7 8 one 0"));
    assert!(matches!(error, MeshReadError::BadLine { line: 14, .. }), "{error}");
    let error = problem(TEXT.replace("0 2 7 8 1 0", "0 2 7 8 nan 0"));
    assert!(
        matches!(error, MeshReadError::NotFinite { vertex: VertexPlace::Obj { line: 14 }, .. }),
        "{error}"
    );
    let error = problem(TEXT.replace("0 1 2 3\n", "0 1 2 4\n"));
    assert!(matches!(error, MeshReadError::IndexOutOfRange { index: 4, count: 4, .. }), "{error}");
    assert!(matches!(problem("ply"), MeshReadError::NotThisFormat { .. }));
    assert!(matches!(problem(""), MeshReadError::NotThisFormat { .. }));
    assert!(matches!(problem(&TEXT[..100]), MeshReadError::CutLine { .. }));
}

#[test]
fn reading_cut_off_or_damaged_files_does_not_panic() {
    for bytes in [TEXT.as_bytes().to_vec(), binary("little", &[[1.0; 3]; 4], 4)] {
        for cut in 0..bytes.len() {
            let _ = read(&bytes[..cut]);
            assert!(
                cut + 2 > bytes.len() || is_whole(&bytes[..cut]).is_err() || read(&bytes[..cut]).is_err()
            );
        }
        for at in 0..bytes.len() {
            for flip in [0x01, 0x10, 0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                let _ = read(&damaged);
            }
        }
    }
}

/// Five vertices of a square and its middle, and this list of strips.
fn strips(list: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
         element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 1 0\n{list}\n"
    )
}

#[test]
fn strips_of_triangles_are_a_mesh_whose_triangles_run_alike() {
    // Two triangles of the square, -1, then a strip that repeats a corner to turn.
    let part = read(strips("9 0 1 2 3 -1 3 1 4 4").as_bytes()).unwrap();
    assert!(!part.is_scan && part.skipped.is_empty());
    let area = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|index| part.positions[index as usize]);
        (b - a).cross(&(c - a)).z / 2.0
    };
    let areas: Vec<f64> = part.triangles.iter().map(|&corners| area(corners)).collect();
    assert_eq!(areas, [0.5; 3], "{:?}", part.triangles);
    // The middle one of three triangles in a strip has the other orientation in the list.
    let part = read(strips("5 0 1 2 3 4").as_bytes()).unwrap();
    assert_eq!(part.triangles.len(), 3);
    assert!(part.triangles[1] == [2, 1, 3] && part.triangles[2] == [2, 3, 4], "{:?}", part.triangles);

    let beyond = problem(strips("4 0 1 2 5"));
    assert!(matches!(beyond, MeshReadError::IndexOutOfRange { index: 5, count: 5, .. }), "{beyond}");
    let negative = problem(strips("4 0 1 2 -2"));
    assert!(matches!(negative, MeshReadError::IndexOutOfRange { index: -2, .. }), "{negative}");
    let unnamed = problem(strips("3 0 1 2").replace("vertex_indices", "corners"));
    assert!(
        matches!(&unnamed, MeshReadError::BadHeader { problem, .. } if problem.contains("strips")),
        "{unnamed}"
    );
    for cut in 0..strips("9 0 1 2 3 -1 3 1 4 4").len() {
        let _ = read(&strips("9 0 1 2 3 -1 3 1 4 4").as_bytes()[..cut]);
    }
}

#[test]
fn points_at_infinity_are_reported_with_the_first_place() {
    let scan = |rows: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n{rows}"
        )
    };
    let part = read(scan("0 0 0\n3 -inf 1\nnan inf 0\n4 5 6\n").as_bytes()).unwrap();
    assert_eq!(part.positions, [Point3::origin(), Point3::new(4.0, 5.0, 6.0)]);
    assert_eq!((part.missing, part.infinite), (1, Some((1, VertexPlace::Obj { line: 9 }))));
    let reading = |bytes: &[u8], format| {
        let options = crate::formats::mesh::MeshOptions::default();
        crate::formats::mesh::read(bytes, format, &options, &std::collections::BTreeMap::new())
    };
    for (text, format) in [
        (scan("0 0 0\n3 -inf 1\n9 8 7\n4 5 6\n"), FORMAT),
        ("0 0 0\n3 -inf 1\n9 8 7\n4 5 6\n".into(), MeshFormat::Xyz),
    ] {
        let facts = reading(text.as_bytes(), format).unwrap().facts;
        let notice = facts.notices.iter().find(|notice| notice.code == "scan-points-far").unwrap();
        let line = if format == FORMAT { "line 9" } else { "line 2" };
        assert!(
            notice.message.starts_with("1 points are at infinity") && notice.message.contains(line),
            "{notice:?}"
        );
        assert_eq!((facts.vertices, facts.size), (3, [9.0, 8.0, 7.0]));
    }
    let far = reading(scan("0 0 0\n1 1 1\n2 3 1e30\n4 5 6\n").as_bytes(), FORMAT).unwrap().facts;
    assert!(far.notices.iter().any(|notice| notice.code == "scan-points-far"), "{far:?}");
}

#[test]
fn rows_with_too_many_or_too_few_values_are_named() {
    let line = |from: &str, to: &str| match problem(TEXT.replace(from, to)) {
        MeshReadError::BadLine { line, text, problem } => (line, text, problem),
        other => panic!("{other}"),
    };
    let (at, text, what) = line("0 1 9 1 1\n", "0 1 9 1 1 128\n");
    assert!(at == 15 && text == "0 1 9 1 1 128" && what.contains("more values"), "{at} {text} {what}");
    let (at, _, what) = line("255 4 0 1 2 3\n", "255 4 0 1 2 3 0\n");
    assert!(at == 17 && what.contains("more values"), "{at} {what}");
    let (at, text, what) = line("0 0 0 1\n", "0 0 0\n");
    assert!(at == 16 && text == "0 0 0" && what.contains("fewer values"), "{at} {text} {what}");
    // A list over several lines, and several rows in one line, are read as values one after the other.
    assert!(read(TEXT.replace("255 4 0 1 2 3\n", "255 4\n0 1\n2 3\n").as_bytes()).is_ok());
    let (header, body) = TEXT.split_once("end_header\n").unwrap();
    let one_line = format!("{header}end_header\n{}\n", body.replace('\n', " "));
    assert_eq!(read(one_line.as_bytes()).unwrap().positions, read(TEXT.as_bytes()).unwrap().positions);
    assert!(read(TEXT.replace('\n', "\r").as_bytes()).is_ok());
}

/// Vertices with colours, normals and texture coordinates of mixed types, and faces with lists beside their corners.
#[test]
fn colours_normals_and_texture_coordinates_of_mixed_types_keep_the_size() {
    let file = |order: &str| {
        let header = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty uchar red\nproperty double x\nproperty short nx\n\
             property float ny\nproperty double nz\nproperty float y\nproperty ushort s\nproperty int z\nproperty char alpha\n\
             property double t\nelement face 1\nproperty uint flags\nproperty list ushort uchar vertex_indices\n\
             property list uchar float texcoord\nproperty short material\nend_header\n"
        );
        let mut bytes = header.into_bytes();
        let mut put = |value: &[u8]| {
            let mut value = value.to_vec();
            if order == "big" {
                value.reverse();
            }
            bytes.extend(value);
        };
        for (x, y, z) in [(0.0, 0.0, 0), (30.0, 0.0, -7), (30.0, 20.0, -7), (0.0, 20.0, 0)] {
            put(&[200]);
            put(&f64::to_le_bytes(x));
            put(&0i16.to_le_bytes());
            put(&0f32.to_le_bytes());
            put(&1f64.to_le_bytes());
            put(&(y as f32).to_le_bytes());
            put(&65_535u16.to_le_bytes());
            put(&i32::to_le_bytes(z));
            put(&[255]);
            put(&0.25f64.to_le_bytes());
        }
        put(&7u32.to_le_bytes());
        put(&4u16.to_le_bytes());
        (0..4u8).for_each(|corner| put(&[corner]));
        put(&[8]);
        (0..8).for_each(|_| put(&0.5f32.to_le_bytes()));
        put(&(-1i16).to_le_bytes());
        bytes
    };
    for order in ["little", "big"] {
        let options = crate::formats::mesh::MeshOptions::default();
        let none = std::collections::BTreeMap::new();
        let part = crate::formats::mesh::read(&file(order), FORMAT, &options, &none).unwrap();
        assert_eq!((part.facts.size, part.facts.triangles), ([30.0, 20.0, 7.0], 2), "{order}");
        assert!(is_whole(&file(order)).is_ok());
    }
}
