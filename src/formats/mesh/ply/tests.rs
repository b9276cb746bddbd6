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
}

#[test]
fn both_byte_orders_give_the_same_points() {
    let points = [[1.5, -2.0, 3.25], [4.0, f32::NAN, 6.0]];
    for order in ["little", "big"] {
        let part = read(&binary(order, &points, 2)).unwrap();
        assert!(part.is_scan);
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
