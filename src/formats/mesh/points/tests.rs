use super::*;

fn points(text: &str) -> Vec<[f64; 3]> {
    let part = read(text.as_bytes()).unwrap_or_else(|error| panic!("{text:?}: {error}"));
    part.positions.iter().map(|point| point.coords.into()).collect()
}

fn problem(text: impl AsRef<[u8]>) -> MeshReadError {
    match read(text.as_ref()) {
        Err(error) => error,
        Ok(part) => panic!("read {:?}", part.positions),
    }
}

#[test]
fn all_usual_forms_of_point_lists_are_read() {
    let expected = [[1.5, -2.0, 3.25], [4.0, 5.5, -6.0]];
    for text in [
        "1.5 -2 3.25\n4 5.5 -6\n",
        "  1.5\t-2   3.25  \r\n\r\n4 5.5 -6",
        "1.5,-2,3.25\n4,5.5,-6\n",
        "1.5, -2, 3.25,\n4, 5.5, -6,\n",
        "1,5;-2;3,25\n4;5,5;-6\n",
        "1,5\t-2\t3,25\n4\t5,5\t-6\n",
        "1,5 -2,0 3,25\n4,0 5,5 -6,0\n",
        "\u{feff}x;y;z\n1.5;-2;3.25\n4;5.5;-6\n",
        "# a comment\n// another\n1.5 -2 3.25 99\n% more\n4 5.5 -6 98\n",
        "\"1.5\",\"-2\",\"3.25\"\n\"4\",\"5.5\",\"-6\"\n",
        "2\n1.5 -2 3.25 -1200 255 0 10\n4 5.5 -6 7 1 2 3\n",
        "1.5 -2 3.25\r4 5.5 -6\r",
        "intensity,Z (mm),X (mm),Y (mm)\n7,3.25,1.5,-2\n8,-6,4,5.5\n",
        "Points:0,Points:1,Points:2\n1.5,-2,3.25\n4,5.5,-6\n",
        "1.5 -2 3.25\nnan nan nan\n4 5.5 -6\n1 2 -9999\n",
        "1.5,-2,3.25\n1,2,\n4,5.5,-6\n",
        "0 0 0\n1.5 -2 3.25\n0 0 0\n4 5.5 -6\n",
    ] {
        assert_eq!(points(text), expected, "{text:?}");
    }
}

#[test]
fn units_above_the_columns_and_in_comments_are_used() {
    let unit = |text: &str| read(text.as_bytes()).unwrap().clues.stated_unit;
    assert_eq!(unit("X [m];Y [m];Z [m]\n1;2;3\n"), Some(LengthUnit::Metre));
    assert_eq!(unit("x (in),y (in),z (in)\n1,2,3\n"), Some(LengthUnit::Inch));
    assert_eq!(unit("x_m,y_m,z_m\n1,2,3\n"), Some(LengthUnit::Metre));
    assert_eq!(unit("X mm,Y mm,Z mm\n1,2,3\n"), Some(LengthUnit::Millimetre));
    assert_eq!(unit("# units: inches\n1 2 3\n"), Some(LengthUnit::Inch));
    assert_eq!(unit("# made with care\n1 2 3\n"), None);
}

#[test]
fn names_of_columns_may_have_blanks_and_words_before_them() {
    for text in [
        "Point ID,X,Y,Z,Confidence\n7,1,2,3,9\n",
        "Point ID,X,Y,Z\n7,1,2,3\n",
        "time stamp;x;y;z;q\n7;1;2;3;9\n",
        "\"Point ID\"\t\"X\"\t\"Y\"\t\"Z\"\n7\t1\t2\t3\n",
        "X coordinate,Y coordinate,Z coordinate,Confidence\n1,2,3,9\n",
        "X mm,Y mm,Z mm,Confidence\n1,2,3,9\n",
        "X [mm] Y [mm] Z [mm] I\n1 2 3 9\n",
        "Z Y X\n3 2 1\n",
        "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nDATA ascii\n1 2 3 9\n",
        "FIELDS intensity x y z\n9 1 2 3\n",
        "# Columns: x y z quality\n1 2 3 9\n",
        "# Columns: quality x y z\n9 1 2 3\n",
        "# Coordinates are x, y, z in mm\n1 2 3\n",
        "# Coordinates are x, y, z in mm\n1 2 3 9\n",
        "# Coordinates are x y z in mm\n1 2 3 4 5 6 7\n",
        "//X,Y,Z\n1,2,3,255,255,255\n",
        "x,y,z,\n1,2,3,\n",
        "x,y,z,i\n1,2,3,\n",
        "x,y,z,i\n1,2,3\n",
    ] {
        assert_eq!(points(text), [[1.0, 2.0, 3.0]], "{text:?}");
    }
    let part = read(b"# Coordinates are x, y, z in mm\n1 2 3 0 0 1 7\n").unwrap();
    assert_eq!(part.normals, [Vector3::z()]);
}

#[test]
fn names_that_do_not_fit_the_columns_are_refused() {
    // The last one is as R writes it, with a name for all columns but the first.
    for text in ["Point ID X Y Z Q\n7 1 2 3\n", "# Point ID X Y Z Q\n7 1 2 3\n", "x y z\n\"7\" 1 2 3\n"] {
        let error = problem(text);
        assert!(matches!(error, MeshReadError::BadHeader { line: 1, .. }), "{error}");
    }
    assert!(
        problem("x,y,z\n7,1,2,3\n")
            .to_string()
            .contains("3 column names, but the first line of points has 4")
    );
    let error = problem("x (mm),y (mm),z (inch)\n1,2,3\n");
    assert!(error.to_string().contains("different units"), "{error}");
}

#[test]
fn three_columns_of_unit_length_are_normals_and_colours_are_not() {
    let normals = |text: &str| read(text.as_bytes()).unwrap().normals;
    assert_eq!(normals("1 2 3 0 0 -1\n4 5 6 0.6 0 0.8\n").len(), 2);
    assert_eq!(normals("1 2 3 0 0 1\n4 5 6 255 0 1\n").len(), 0);
    assert_eq!(normals("x,y,z,i,nx,ny,nz\n1,2,3,7,0,0,1\n")[0], Vector3::z());
}

#[test]
fn lists_without_points_state_what_they_lack() {
    for (text, line, columns, what) in [
        ("1\n2\n", 1, 1, "The list of points has 1 column; it needs x, y and z."),
        ("# scan\nx y\n1.5 2\n3 4\n", 3, 2, "The list of points has 2 columns; it needs x, y and z."),
        ("1;2\n", 1, 2, "The list of points has 2 columns; it needs x, y and z."),
        ("0,5 1,5\n", 1, 2, "The list of points has 2 columns; it needs x, y and z."),
    ] {
        let error = problem(text);
        assert_eq!(error, MeshReadError::TooFewColumns { line, columns }, "{text:?}");
        assert_eq!(error.reason().what, what);
        assert_eq!(error.reason().remedy, "Export the scan again with one point per line: x, y, z.");
    }
    for (text, what) in [
        ("x,y,z\n", "The list of points has a header but no points."),
        ("# made by a scanner\n", "The list of points has comments but no points."),
    ] {
        let reason = problem(text).reason();
        assert_eq!((reason.code.as_str(), reason.what.as_str()), ("scan-empty", what));
    }
}

#[test]
fn decimal_commas_between_commas_are_refused_and_between_blanks_are_read() {
    for text in
        ["0,5, 0,1, 0,0\n1,5, 0,1, 0,0\n", "x y z\n-0,5, 0,1, 0,0, 7,5\n", "x,y,z\n0,500,-0,100,0,000\n"]
    {
        let reason = problem(text).reason();
        assert_eq!(reason.code, "mesh-line-invalid");
        assert_eq!(reason.what, "The numbers seem to have decimal commas.");
        assert_eq!(reason.remedy, "Export the scan with decimal points.");
    }
    for text in ["0,5 0,1 0,0\n", "0,5;0,1;0,0\n", "0.5, 0.1, 0.0\n", "0.5,0.1,0.0\n"] {
        assert_eq!(points(text), [[0.5, 0.1, 0.0]], "{text:?}");
    }
    // Whole numbers with a colour.
    assert_eq!(points("10,20,30,40,50,60\n11,21,31,41,51,61\n"), [[10.0, 20.0, 30.0], [11.0, 21.0, 31.0]]);
    assert_eq!(points("1,2, 3,4, 5,6\n1, 2, 3\n"), [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]);
}

#[test]
fn errors_are_reported_with_their_line() {
    for (text, line) in [
        ("1 2 3\n4 5\n6 7 8\n", 2),
        ("# x\n1,2,3\n4,five,6\n", 3),
        ("x y z i\n1 2 3 4\n1 2 3 4\n5 6\n7 8 9 1\n", 4),
    ] {
        let error = problem(text);
        assert!(matches!(error, MeshReadError::BadLine { line: at, .. } if at == line), "{error}");
    }
    assert!(matches!(problem("1 2 3\n4 5"), MeshReadError::BadLine { line: 2, .. }));
    assert!(matches!(is_whole(b"1 2 3\n4 5"), Err(MeshReadError::CutLine { line: 2, .. })));
    assert!(is_whole(b"1 2 3\n4 5 6").is_ok() && is_whole(b"1 2 3\n4 5 6\n").is_ok());
    assert!(matches!(problem("nan nan nan\n1 nan 2\n"), MeshReadError::NoPoints { missing: 2 }));
    assert!(matches!(problem("ncols 3\nnrows 2\n1 2 3\n4 5 6\n"), MeshReadError::BadHeader { line: 1, .. }));
    for text in ["name;price\nscrew;3\n", "\u{0}\u{1}", "hello world"] {
        assert!(matches!(problem(text), MeshReadError::NotThisFormat { .. }), "{text:?}");
    }
    for text in ["", "\u{feff}"] {
        assert_eq!(problem(text), MeshReadError::EmptyFile, "{text:?}");
    }
    let wide: Vec<u8> = "1 2 3\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert!(matches!(problem([b"\xFF\xFE", &wide[..]].concat()), MeshReadError::NotThisFormat { .. }));
}
