use super::*;
use crate::reason::Severity;

/// A part with corners at 0 and `size`, in the file's numbers.
fn corners(size: [f64; 3]) -> Corners {
    Corners { min: Vector3::zeros(), size: Vector3::from(size), is_turned_back: false }
}

fn clues(format: MeshFormat, producer: &str) -> Clues {
    Clues::new(format, (!producer.is_empty()).then(|| producer.to_string()))
}

/// Unit, axis, and the severity of both notices.
fn decided(clues: &Clues, corners: &Corners) -> (LengthUnit, UpAxis, [Severity; 2]) {
    let verdict = clues.judge(corners, &MeshOptions::default());
    assert!(!verdict.unit.why.is_empty() && !verdict.up.why.is_empty());
    let severity = |code: &str| verdict.notices.iter().find(|notice| notice.code == code).unwrap().severity;
    (verdict.unit.value, verdict.up.value, [severity("unit-assumed"), severity("axis-assumed")])
}

use LengthUnit::{Metre, Millimetre};
use MeshFormat::{Glb, Obj};
use Severity::{Note, Warning};
use UpAxis::{Y, Z};

#[test]
fn the_standard_applies_unless_the_size_contradicts_it() {
    let program = clues(Glb, "some program");
    assert_eq!(decided(&program, &corners([0.066, 0.115, 0.066])), (Metre, Y, [Note, Note]));
    assert_eq!(decided(&program, &corners([66.0, 115.0, 66.0])), (Millimetre, Y, [Warning, Warning]));
    let blender = clues(Glb, "Khronos glTF Blender I/O v4.2.83");
    assert_eq!(decided(&blender, &corners([66.0, 115.0, 66.0])), (Millimetre, Y, [Warning, Note]));
}

#[test]
fn long_parts_of_the_freecad_workbench_are_in_metres() {
    let source = include_str!("../../../../plugins/freecad/freecad/Isomark/part.py");
    assert!(source.contains(&format!("\"{FREECAD_WORKBENCH}\"")));
    let workbench = clues(Glb, FREECAD_WORKBENCH);
    assert_eq!(decided(&workbench, &corners([0.06, 6.0, 0.06])), (Metre, Y, [Note, Note]));
}

#[test]
fn blender_files_of_an_imported_z_up_obj_are_set_upright() {
    let mut blender = clues(Glb, "Khronos glTF Blender I/O v5.2.41");
    blender.root_turn = RootTurn::UpToFront;
    assert_eq!(decided(&blender, &corners([66.0, 66.0, 115.0])), (Millimetre, Z, [Warning, Warning]));
    // In metres the designer may have made the rotation.
    assert_eq!(decided(&blender, &corners([0.066, 0.066, 0.115])), (Metre, Y, [Note, Note]));
}

#[test]
fn signed_zeros_in_normals_show_the_axis_of_open_cascade_files() {
    let mut cascade = clues(Glb, "Open CASCADE Technology 8.0 [dev.opencascade.org]");
    let can = corners([0.066, 0.066, 0.115]);
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Warning]));
    cascade.zeros.count([0.0, -1.0, 0.0]);
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Note]));
    cascade.zeros.count([-0.0, -0.0, -1.0]);
    assert_eq!(decided(&cascade, &can), (Metre, Z, [Note, Warning]));
    cascade.root_turn = RootTurn::FrontToUp;
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Note]));
}

#[test]
fn turned_parts_of_open_cascade_stand_upright_unless_their_vertices_are_converted() {
    use nalgebra::{Matrix4, Rotation3};
    let about = |axis: Vector3<f64>, degrees: f64| Rotation3::new(axis * degrees.to_radians());
    let upright = about(Vector3::x(), -90.0);
    let placed = |turn: Rotation3<f64>, normals: &[[f32; 3]]| {
        let mut cascade = clues(Glb, "Open CASCADE Technology 7.9 [dev.opencascade.org]");
        cascade.root_pose = RootPose::of(&turn.to_homogeneous());
        normals.iter().for_each(|&normal| cascade.zeros.count(normal));
        let decided = decided(&cascade, &corners([0.06, 0.04, 0.025]));
        (decided.1, decided.2[1], cascade.misplaced(decided.1).is_some())
    };
    let (raw, converted) = ([[-0.0, -0.0, -1.0]], [[0.0, -1.0, 0.0]]);
    let (turned, tilted) = (about(Vector3::z(), 30.0), about(Vector3::y(), 30.0));
    assert_eq!(placed(turned * upright, &raw), (Y, Warning, true));
    assert_eq!(placed(tilted * upright, &raw), (Y, Warning, true));
    assert_eq!(placed(turned * upright, &[]), (Y, Warning, true));
    assert_eq!(placed(tilted * upright, &[]), (Y, Warning, false));
    // OpenCASCADE's own files: nodes have the rotations of CAD, in the axes of the vertices.
    assert_eq!(placed(turned, &raw), (Z, Warning, false));
    assert_eq!(placed(about(Vector3::y(), 30.0), &converted), (Y, Note, false));
    assert_eq!(placed(turned * upright, &converted), (Y, Note, false));
    let scaled = Matrix4::new_scaling(2.0);
    assert_eq!((RootPose::of(&scaled), RootPose::of(&-Matrix4::identity())), (None, None));
}

#[test]
fn the_axes_of_files_from_trimesh_are_a_guess() {
    let trimesh = clues(Glb, "https://github.com/mikedh/trimesh");
    assert_eq!(decided(&trimesh, &corners([0.066, 0.066, 0.115])), (Metre, Y, [Note, Warning]));
}

#[test]
fn unit_and_axis_of_obj_files_depend_on_their_producer() {
    let can = corners([66.0, 66.0, 115.0]);
    assert_eq!(decided(&clues(Obj, "Created by FreeCAD <http>"), &can), (Millimetre, Z, [Note, Note]));
    assert_eq!(decided(&clues(Obj, ""), &can), (Millimetre, Z, [Warning, Warning]));
    let in_metres = corners([0.066, 0.066, 0.115]);
    assert_eq!(decided(&clues(Obj, "Blender 4.2"), &in_metres), (Metre, Y, [Note, Note]));
    assert_eq!(decided(&clues(Obj, ""), &in_metres), (Metre, Z, [Warning, Warning]));
}

#[test]
fn rounding_or_the_base_plane_shows_the_axis_of_blender_obj_files_in_mm() {
    let blender = clues(Obj, "Blender 5.2.3 LTS");
    let standing = |min: [f64; 3], is_turned_back| {
        let size = Vector3::new(66.0, 66.0, 115.0);
        decided(&blender, &Corners { min: Vector3::from(min), size, is_turned_back }).1
    };
    assert_eq!(standing([-33.0, -33.0, 0.1], false), Z);
    assert_eq!(standing([-33.0, 0.1, -33.0], false), Y);
    assert_eq!(standing([-33.0, -33.0, -50.0], false), Y);
    assert_eq!(standing([-33.0, -33.0, -50.0], true), Z);
}

#[test]
fn only_the_rounding_of_a_rotation_shows_that_blender_imported_an_obj_with_z_up() {
    let is_turned_back = |positions: &[[f64; 3]]| {
        let positions: Vec<Point3<f64>> = positions.iter().map(|&position| position.into()).collect();
        Corners::of(&positions, &[[0, 1, 2]]).is_turned_back
    };
    // From Blender 4.5: balls of R 40 and R 12, imported with Z up as if Y were up.
    let ball = [
        [0.0, -0.000003, -40.0],
        [10.352762, -0.000003, -38.637032],
        [20.0, -0.000002, -20.0],
        [38.637032, -0.000001, -10.352762],
        [20.0, 34.641014, -0.000003],
        [34.641014, 20.0, -0.000002],
        [38.637032, -10.352762, 0.000001],
        [0.0, 0.000003, 40.0],
    ];
    let small = [
        [0.0, -0.000001, -12.0],
        [3.105829, -0.000001, -11.59111],
        [6.0, 10.392305, -0.000001],
        [12.0, 0.0, 3.1],
    ];
    assert!(is_turned_back(&ball) && is_turned_back(&small));
    // From Blender 4.5 as well, modelled there: an ico sphere, a subdivided box, and a box with loop cuts.
    let ico = [
        [0.0, -30.0, 0.0],
        [25.519434, -15.772077, 0.000001],
        [28.531738, 0.0, 9.27038],
        [0.0, 0.0, 29.999998],
        [-25.519434, 15.772077, -0.000001],
        [24.270576, -0.000001, -17.633463],
    ];
    let subdivided = [
        [30.0, 0.0, 0.000001],
        [-9.999999, 0.0, -16.666668],
        [-26.66667, 1.666667, 0.0],
        [10.000002, 27.259262, 0.0],
    ];
    let cut = [
        [-39.0, 0.0, 17.0],
        [39.0, 0.0, -17.0],
        [-39.0, 0.0, 0.000001],
        [-39.707104, 0.292893, -0.000001],
        [-39.0, 12.0, -0.000001],
    ];
    assert!(!is_turned_back(&ico) && !is_turned_back(&subdivided) && !is_turned_back(&cut));
    // From Blender 3.4, a dome with the modifier Solidify: most coordinates that this rotation would make ±0.000001 are zero.
    let dome = [
        [25.113955, 7.985518, -0.000001],
        [26.673199, 7.342337, -0.000001],
        [-20.427061, 9.684417, 0.0],
        [-18.861855, 10.173536, 0.0],
        [-17.295292, 10.623915, 0.0],
    ];
    assert!(!is_turned_back(&dome));
    // Errors in x are none of this rotation.
    assert!(!is_turned_back(&[&ball[..], &[[0.000003, 5.0, 5.0]]].concat()));
}

#[test]
fn settings_override_without_a_notice() {
    let options = MeshOptions { unit: Some(LengthUnit::Centimetre), up: Some(Z), ..MeshOptions::default() };
    let verdict = clues(Glb, "").judge(&corners([6.6, 6.6, 11.5]), &options);
    assert_eq!((verdict.unit.value, verdict.up.value), (LengthUnit::Centimetre, Z));
    assert_eq!(verdict.unit.why, "the settings say so");
    assert!(verdict.notices.is_empty(), "{:?}", verdict.notices);
}

#[test]
fn implausible_sizes_are_reported_with_their_number() {
    for (size, number) in [(0.0005, "0.500 mm"), (3.0, "3000.000 mm")] {
        let verdict = clues(Glb, "").judge(&corners([size, 0.0, 0.0]), &MeshOptions::default());
        let notice = verdict.notices.iter().find(|notice| notice.code == "size-implausible").unwrap();
        assert!(notice.message.contains(number), "{}", notice.message);
        assert_eq!(notice.severity, Warning);
    }
}

#[test]
fn a_comment_states_a_unit_only_right_after_the_word() {
    for (comment, unit) in [
        ("units: mm", Some(Millimetre)),
        ("Units = Meters", Some(Metre)),
        ("File units = centimeters", Some(LengthUnit::Centimetre)),
        ("length_unit: m", Some(Metre)),
        ("unit inch", Some(LengthUnit::Inch)),
        ("all units in mm", Some(Millimetre)),
        ("units are in inches", Some(LengthUnit::Inch)),
        ("unit: in", Some(LengthUnit::Inch)),
        ("Units [mm]", Some(Millimetre)),
        ("\"units\": \"mm\"", Some(Millimetre)),
        ("Scanned with unit 3 by J. M Smith", None),
        ("unit M", None),
        ("unit: 0.001 m", None),
        ("heating unit 2 inch pipe", None),
        ("united metre works", None),
        ("a community in mm", None),
        ("", None),
    ] {
        assert_eq!(stated_unit(comment), unit, "{comment}");
    }
}
