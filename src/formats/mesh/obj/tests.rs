use std::collections::BTreeMap;

use super::check::MAX_CORNERS;
use super::*;
use crate::formats::mesh::{self, MeshOptions, PartReading, VertexPlace};

fn read_obj(text: impl AsRef<[u8]>) -> Result<PartReading, MeshReadError> {
    mesh::read(text.as_ref(), MeshFormat::Obj, &MeshOptions::default(), &BTreeMap::new())
}

/// The four vertices of a plate of 10 x 10 mm.
const PLATE: &str = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\n";

fn plate(rest: &str) -> Result<PartReading, MeshReadError> {
    read_obj(format!("{PLATE}{rest}"))
}

fn area(part: &PartReading) -> f64 {
    let of = |corners| {
        let [a, b, c]: [Point3<f64>; 3] = part.shape.mesh().unwrap().corners(corners);
        (b - a).cross(&(c - a)).z / 2.0
    };
    part.shape.mesh().unwrap().triangles().iter().map(|&corners| of(corners)).sum()
}

#[test]
fn comments_after_numbers_are_no_numbers() {
    let text = PLATE.replace("10 10 0", "10 10 0 # the corner 99") + "o lid #2\nf 1 2 3 4 # top\n";
    let part = read_obj(text).unwrap();
    assert_eq!((part.facts.triangles, area(&part)), (2, 100.0));
    assert_eq!(part.facts.bodies, ["lid #2"]);
    assert!(matches!(plate("f 1 2 # 3\n"), Err(MeshReadError::BadLine { line: 5, .. })));
}

#[test]
fn all_forms_of_faces_are_read() {
    let before = "vn 0 0 1\nvt 0 0\n";
    let without_normals = ["f 1 2 3 4", "f 1/1 2/1 3/1 4/1", "f -4 -3 -2 -1"];
    let with_normals =
        ["f 1//1 2//1 3//1 4//1", "f 1/1/1 2/1/1 3/1/1 4/1/1", "f -4//-1 -3//-1 -2//-1 -1//-1"];
    for (faces, normals) in [(without_normals, 0), (with_normals, 4)] {
        for face in faces {
            let part = plate(&format!("{before}{face}\n")).unwrap();
            assert_eq!((part.facts.triangles, part.facts.vertices, area(&part)), (2, 4, 100.0), "{face}");
            assert_eq!(part.shape.mesh().unwrap().normals().len(), normals, "{face}");
        }
    }
}

#[test]
fn concave_faces_are_triangulated_inside_their_outline() {
    let part = read_obj("v 0 0 0\nv 4 -2 0\nv 1 0 0\nv 4 2 0\nf 2 3 4 1\n").unwrap();
    assert_eq!((part.facts.triangles, area(&part)), (2, 2.0));
    for [a, b, c] in part
        .shape
        .mesh()
        .unwrap()
        .triangles()
        .iter()
        .map(|&corners| part.shape.mesh().unwrap().corners(corners))
    {
        assert!((b - a).cross(&(c - a)).z > 0.0);
    }
}

#[test]
fn line_breaks_marks_and_encodings_of_any_system_are_read() {
    let windows = PLATE.replace('\n', "\r\n") + "f 1 2 3 4\r\n";
    assert_eq!(area(&read_obj(windows).unwrap()), 100.0);
    let old = PLATE.replace('\n', "\r") + "f 1 2 3 4\r";
    assert_eq!(area(&read_obj(old).unwrap()), 100.0);
    assert_eq!(area(&read_obj(format!("\u{feff}{PLATE}f 1 2 3 4\n")).unwrap()), 100.0);
    assert_eq!(area(&plate("f 1 2 \\\n  3\\\n 4\n").unwrap()), 100.0);
    assert_eq!(area(&plate("\tf\t1  2\t3 4   \n\n# end\n").unwrap()), 100.0);
    let latin = [PLATE.as_bytes(), b"o Geh\xE4use\nf 1 2 3 4\n"].concat();
    assert_eq!(read_obj(latin).unwrap().facts.bodies, ["Geh\u{fffd}use"]);
    assert_eq!(area(&read_obj("v 0 0 0 1 0 0\nv 10 0 0 1 0 0\nv 0 10 0 1 0 0\nf 1 2 3\n").unwrap()), 50.0);
    assert_eq!(area(&read_obj("f 1 2 3\nv 0 0 0\nv 10 0 0\nv 0 10 0\n").unwrap()), 50.0);
}

#[test]
fn lines_points_and_unknown_statements_are_reported() {
    let part = plate("l 1 2\nl 2 3\np 4\nquark 7\nf 1 2 3 4\n").unwrap();
    let named = ["2 x line (l)", "1 x set of points (p)", "unknown statements such as \"quark 7\""];
    assert_eq!(part.facts.skipped, named);
    assert_eq!(area(&part), 100.0);
}

#[test]
fn only_names_that_faces_use_are_reported() {
    let part =
        plate("g none\ng base\nusemtl steel\nf 1 2 3\ng badge\nusemtl red\nf 1 3 4\nusemtl steel\nf 1 2 3\n")
            .unwrap();
    assert_eq!(part.facts.bodies, ["base", "badge"]);
    assert_eq!(part.facts.materials, ["steel", "red"]);
    let part = plate("o Whole\ng a\nf 1 2 3\ng b\nf 1 3 4\n").unwrap();
    assert_eq!(part.facts.bodies, ["Whole"]);
}

#[test]
fn corners_that_share_position_and_normal_share_a_vertex() {
    let normals = "vn 0 0 1\nvn 0.1 0 1\n";
    let part = plate(&format!("{normals}f 1//1 2//2 3//1\nf 1//1 3//1 4//2\nf 3//2 2//2 1//1\n")).unwrap();
    assert_eq!(part.facts.vertices, 5);
    assert_eq!(part.facts.normals, NormalsFound::Smooth);
    assert!((part.shape.mesh().unwrap().normals()[1].x - 0.1 / 1.01f64.sqrt()).abs() < 1e-12);
}

#[test]
fn corners_without_a_normal_stay_without_one() {
    let part = plate("vn 0 0.1 1\nf 1 2//1 -2\nf 1//1 3//1 4\n").unwrap();
    assert_eq!((part.facts.triangles, part.facts.vertices, area(&part)), (2, 6, 100.0));
    let is_missing: Vec<bool> =
        part.shape.mesh().unwrap().normals().iter().map(|normal| normal.norm() == 0.0).collect();
    assert_eq!(is_missing, [true, false, true, false, false, true]);
    assert_eq!(plate("vn 0 0 1\nf 1 2 3 4\n").unwrap().facts.normals, NormalsFound::None);
}

#[test]
fn corners_that_name_a_missing_normal_are_read_without_one_and_reported() {
    let part = plate("vn 0 0.1 1\nf 1//1 2//2 3//-1\nf 1//1 3//1 4//0\n").unwrap();
    let is_missing: Vec<bool> =
        part.shape.mesh().unwrap().normals().iter().map(|normal| normal.norm() == 0.0).collect();
    assert_eq!((area(&part), is_missing.iter().filter(|missing| **missing).count()), (100.0, 2));
    let notice = |part: &PartReading| {
        let found = part.facts.notices.iter().find(|notice| notice.code == "obj-normals-absent");
        found.map(|notice| notice.message.clone())
    };
    let message = notice(&part).unwrap();
    assert!(
        message.starts_with("2 face corners") && message.contains("line 6") && message.contains("1 normals"),
        "{message}"
    );
    // No normal at all, normals before the first, normals after the faces, and numbers that no file reaches.
    for faces in
        ["f 1//1 2//1 3//1 4//1\n", "f 1//-1 2//-1 3//-1 4//-1\n", "f 1//999999999999 2//7 3//7 4//7\n"]
    {
        let part = plate(faces).unwrap();
        assert_eq!(
            (area(&part), part.facts.normals, notice(&part).is_some()),
            (100.0, NormalsFound::None, true),
            "{faces}"
        );
    }
    let later = plate("f 1//1 2//1 3//1 4//2\nvn 0 0 1\n").unwrap();
    assert_eq!((area(&later), notice(&later).is_some()), (100.0, true));
    assert!(notice(&plate("f 1//1 2//1 3//1 4//1\nvn 0 0 1\n").unwrap()).is_none());
}

#[test]
fn bad_lines_are_refused_with_their_number() {
    let line_of = |rest: &str| plate(rest).unwrap_err().reason().place.line;
    assert_eq!(line_of("v 1,5 0 0\nf 1 2 3\n"), Some(5));
    assert_eq!(line_of("v 1 0\nf 1 2 3\n"), Some(5));
    assert_eq!(line_of("f 1 2 3\nf 1 x 3\n"), Some(6));
    assert_eq!(line_of("f 1 2\nf 1 2 3\n"), Some(5));
    for number in ["nan", "inf", "-inf", "1e999"] {
        let refused = plate(&format!("\nv 1 {number} 0\nf 1 2 3\n")).unwrap_err();
        assert!(
            matches!(refused, MeshReadError::NotFinite { vertex: VertexPlace::Obj { line: 6 }, .. }),
            "{number}"
        );
    }
    for (face, index, line) in [("f 1 2 5\n", 5, 5), ("f 1 2 0\n", 0, 5), ("f 1 2 3\nf -1 -2 -5\n", -5, 6)] {
        let face_line = VertexPlace::Obj { line };
        let refused = MeshReadError::IndexOutOfRange { face: face_line, kind: "vertex", index, count: 4 };
        assert_eq!(plate(face), Err(refused), "{face}");
    }
    assert_eq!(line_of("f 1 2 99999999999999999999\n"), Some(5));
}

#[test]
fn a_file_cut_off_in_its_last_line_is_refused_or_reported() {
    let line = 5;
    assert_eq!(plate("f 1 2"), Err(MeshReadError::CutLine { line, text: "f 1 2".into() }));
    assert_eq!(read_obj("v 0 0 0\nv 1 0"), Err(MeshReadError::CutLine { line: 2, text: "v 1 0".into() }));
    let open = plate("f 1 2 3").unwrap();
    assert_eq!(open.facts.notices[0].code, "last-line-open");
    let closed = plate("f 1 2 3\n").unwrap();
    assert!(closed.facts.notices.iter().all(|notice| notice.code != "last-line-open"));
}

#[test]
fn files_without_faces_name_the_likely_cause() {
    let cause = |text: &str| match read_obj(text) {
        Err(MeshReadError::NoTriangles { cause }) => cause,
        other => panic!("{other:?}"),
    };
    let arch = "# FreeCAD v0.20 build2 Arch module\n# http://www.freecadweb.org\nmtllib part.mtl\n";
    assert_eq!(cause(arch), EmptyCause::ArchContainer);
    assert_eq!(cause("v 0 0 0\nv 1 0 0\nl 1 2\n"), EmptyCause::OnlyOthers(vec!["1 x line (l)".into()]));
    assert_eq!(cause(PLATE), EmptyCause::Nothing);
    assert_eq!(cause("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), EmptyCause::Flat);
    assert_eq!(read_obj(b"").unwrap_err(), MeshReadError::EmptyFile);
    for foreign in [&b"solid can\n"[..], b"ISO-10303-22;\n", b"v 0 0 0\0\0"] {
        let refused = read_obj(foreign);
        assert!(matches!(refused, Err(MeshReadError::NotThisFormat { .. })), "{refused:?}");
    }
}

#[test]
fn a_face_with_absurdly_many_corners_is_refused() {
    let corners = " 1".repeat(MAX_CORNERS + 1);
    let refused = plate(&format!("f{corners}\n"));
    assert!(matches!(refused, Err(MeshReadError::TooLarge { limit: 10_000, .. })), "{refused:?}");
}

#[test]
fn a_unit_in_the_header_is_used() {
    let sized = |head: &str| read_obj(format!("{head}\n{PLATE}f 1 2 3 4\n")).unwrap().facts.size[0];
    assert_eq!(sized("# File units = inches"), 254.0);
    assert_eq!(sized("# Units: mm"), 10.0);
    assert_eq!(sized("# all units in cm"), 100.0);
    assert_eq!(sized("# a unit cube"), 10.0);
    assert_eq!(sized("# made by hand"), 10.0);
}
