//! The mark on the part in three dimensions, read back with an independent glTF reader and judged on formulas.

use fs_err as fs;
use gltf::mesh::Mode;
use serde_json::Value;

use crate::desk::{Desk, drawing, number, numbers, part};
use crate::khronos;

const CAN: &str = "--facing -y --place 0,60 --on-part on.glb";
/// Radius of the can of the samples, mm; its axis is the z axis.
const RADIUS: f64 = 33.0;

/// The trough has two faces with four corners; those under a drawing are divided for the picture.
#[test]
fn the_page_counts_the_triangles_of_the_file() {
    let desk = Desk::new();
    desk.write(
        "trough.obj",
        "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n",
    );
    desk.correct("trough.obj", &drawing("square"), "--report-html page.html");
    let page = desk.text("page.html");
    assert!(page.contains("mm, the 4 triangles of its file"), "{}", page.split("triangles").next().unwrap());
}

/// A scene that was read back, in mm with +Z up.
struct Picture {
    bytes: Vec<u8>,
    /// `extras.isomark` of the root.
    facts: Value,
    nodes: Vec<Node>,
}

struct Node {
    name: String,
    lines: Vec<Line>,
    triangles: Vec<[[f64; 3]; 3]>,
    normals: Vec<[f64; 3]>,
    modes: Vec<Mode>,
}

#[derive(Default)]
struct Line {
    points: Vec<[f64; 3]>,
    /// Linear red, green and blue.
    colors: Vec<[f32; 3]>,
}

impl Picture {
    fn of(bytes: Vec<u8>) -> Self {
        let glb = gltf::Glb::from_slice(&bytes).unwrap();
        let binary = glb.bin.unwrap().into_owned();
        let document = gltf::Gltf::from_slice(&bytes).unwrap();
        let scene = document.default_scene().unwrap();
        let root = scene.nodes().next().unwrap();
        assert_eq!((root.name(), scene.nodes().count()), (Some("isomark-mark"), 1));
        let extras: Value = serde_json::from_str(root.extras().as_ref().unwrap().get()).unwrap();
        let nodes = root.children().map(|node| {
            assert_eq!(node.transform().decomposed(), ([0.0; 3], [0.0, 0.0, 0.0, 1.0], [1.0; 3]));
            let mesh = node.mesh().unwrap();
            assert_eq!(mesh.name(), node.name());
            let mut read = Node {
                name: node.name().unwrap().to_owned(),
                lines: Vec::new(),
                triangles: Vec::new(),
                normals: Vec::new(),
                modes: Vec::new(),
            };
            for primitive in mesh.primitives() {
                let reader = primitive.reader(|_| Some(&binary));
                let points: Vec<[f64; 3]> = reader.read_positions().unwrap().map(in_part_frame).collect();
                let indices: Option<Vec<u32>> = reader.read_indices().map(|read| read.into_u32().collect());
                let colors =
                    reader.read_colors(0).map(|colors| colors.into_rgb_f32().collect()).unwrap_or_default();
                read.modes.push(primitive.mode());
                let at = |index: &u32| points[*index as usize];
                match primitive.mode() {
                    Mode::LineStrip => read.lines.push(Line { points, colors }),
                    Mode::Lines => read.lines.extend(
                        indices
                            .unwrap()
                            .chunks_exact(2)
                            .map(|ends| Line { points: ends.iter().map(at).collect(), colors: Vec::new() }),
                    ),
                    Mode::Triangles => {
                        let corners = indices.unwrap();
                        read.triangles
                            .extend(corners.chunks_exact(3).map(|c| [at(&c[0]), at(&c[1]), at(&c[2])]));
                        let normals = reader.read_normals().into_iter().flatten();
                        read.normals.extend(normals.map(|[x, y, z]| [x, -z, y].map(f64::from)));
                    }
                    mode => panic!("{mode:?}"),
                }
            }
            read
        });
        let nodes = nodes.collect();
        Self { facts: extras["isomark"].clone(), nodes, bytes }
    }

    fn names(&self) -> Vec<&str> {
        self.nodes.iter().map(|node| node.name.as_str()).collect()
    }

    fn node(&self, name: &str) -> &Node {
        self.nodes
            .iter()
            .find(|node| node.name == name)
            .unwrap_or_else(|| panic!("no {name} in {:?}", self.names()))
    }

    /// The lowest and the highest corner of the part, mm.
    fn part_bounds(&self) -> [[f64; 3]; 2] {
        bounds(self.node("part").triangles.iter().flatten())
    }
}

/// A point of glTF, m with +Y up, in mm with +Z up.
fn in_part_frame([x, y, z]: [f32; 3]) -> [f64; 3] {
    [x, -z, y].map(|value| f64::from(value) * 1000.0)
}

fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> [[f64; 3]; 2] {
    points.fold([[f64::MAX; 3], [f64::MIN; 3]], |[min, max], point| {
        [[0, 1, 2].map(|axis| min[axis].min(point[axis])), [0, 1, 2].map(|axis| max[axis].max(point[axis]))]
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    [0, 1, 2].map(|axis| (b[axis] - a[axis]).powi(2)).iter().sum::<f64>().sqrt()
}

fn length(lines: &[Line]) -> f64 {
    lines.iter().flat_map(|line| line.points.windows(2)).map(|ends| distance(ends[0], ends[1])).sum()
}

fn area(triangles: &[[[f64; 3]; 3]]) -> f64 {
    let of = |[a, b, c]: &[[f64; 3]; 3]| {
        let [x, y, z] = [distance(*a, *b), distance(*b, *c), distance(*c, *a)];
        let half = (x + y + z) / 2.0;
        (half * (half - x) * (half - y) * (half - z)).max(0.0).sqrt()
    };
    triangles.iter().map(of).sum()
}

/// Corrects a drawing on a part and reads the picture.
fn picture(desk: &Desk, inputs: &[&str], options: &str) -> (Picture, Value) {
    let report = desk.correct_to("out.dxf", inputs, options);
    (Picture::of(desk.read("on.glb")), report)
}

fn radius([x, y, _]: [f64; 3]) -> f64 {
    x.hypot(y)
}

#[test]
fn the_mark_is_on_the_can_with_the_lengths_that_were_drawn() {
    let desk = Desk::new();
    let (picture, report) = picture(&desk, &[&part("can/fc020-gui.glb"), &drawing("abc")], CAN);
    assert_eq!(picture.names(), ["part", "mark-ink", "mark", "drawn", "view"]);
    let (drawn, length_drawn) = (picture.node("drawn"), number(&report, "/quality/after/length_mm"));
    for line in picture.node("mark").lines.iter().chain(&drawn.lines) {
        for point in &line.points {
            let off = radius(*point) - RADIUS;
            assert!((0.0..0.03).contains(&off), "{off} mm off the can at {point:?}");
            assert!(point[1] < 0.0, "{point:?} is on the other side");
        }
    }
    // The lines are lifted by 0.02 mm, which makes those round the can longer by 0.06 %.
    let on_can = length(&picture.node("mark").lines);
    assert!((on_can / length_drawn - 1.0).abs() < 7e-4, "{on_can} for {length_drawn} mm");
    // Without a correction the lines are longer by more than the report's length error.
    let excess = length(&drawn.lines) - length_drawn;
    let expected = number(&report, "/quality/before/length_error_mm");
    assert!((excess - expected).abs() < 0.02 * length_drawn && excess > 1.0, "{excess} for {expected} mm");
    let ranges = &picture.facts["stretch_range"];
    assert_eq!(numbers(ranges, "/1").len(), 2);
    assert!(number(ranges, "/0/1") > 0.05 && number(ranges, "/1/1") < 0.001, "{ranges}");
    for (key, value) in [
        ("schema", "isomark.on-part/1"),
        ("sku", "fc020-gui"),
        ("drawing", "abc.dxf"),
        ("part_source", "file"),
    ] {
        assert_eq!(picture.facts[key], value);
    }
    assert_eq!(numbers(&picture.facts, "/towards_laser"), [0.0, -1.0, 0.0]);
    assert_eq!(picture.facts["part_thinned"], false);
}

#[test]
fn the_ink_covers_the_inked_area_on_the_surface() {
    let desk = Desk::new();
    let (picture, report) = picture(&desk, &[&part("can/fc020-gui.glb"), &drawing("abc")], CAN);
    let ink = picture.node("mark-ink");
    let (found, expected) = (area(&ink.triangles), number(&report, "/quality/after/area_mm2"));
    // The report's area is that of squares of 0.2 mm.
    assert!((found / expected - 1.0).abs() < 0.01, "{found} for {expected} mm²");
    for [a, b, c] in &ink.triangles {
        for [i, j, k] in [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.34, 0.33, 0.33], [0.2, 0.2, 0.6]] {
            let inside = [0, 1, 2].map(|axis| a[axis] * i + b[axis] * j + c[axis] * k);
            let off = radius(inside) - RADIUS;
            assert!((0.0..0.03).contains(&off), "{off} mm off the can at {inside:?}");
        }
        // The outer side faces outwards.
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]];
        assert!(normal[0] * a[0] + normal[1] * a[1] > 0.0, "{a:?} {b:?} {c:?}");
    }
}

/// What the preview's scale means: dark is true, orange is too long.
#[test]
fn the_colours_show_where_lines_are_too_long() {
    let desk = Desk::new();
    let (picture, _) = picture(&desk, &[&part("can/fc020-gui.glb"), &drawing("abc")], CAN);
    // #111827 as linear light.
    let dark = [0.005_605, 0.009_134, 0.020_289];
    for line in &picture.node("mark").lines {
        assert_eq!(line.colors.len(), line.points.len());
        for color in &line.colors {
            assert!(color.iter().zip(dark).all(|(found, dark)| (found - dark).abs() < 1e-4), "{color:?}");
        }
    }
    let mut longest: Option<(f64, [f32; 3])> = None;
    for line in &picture.node("drawn").lines {
        for ((ends, color), next) in line.points.windows(2).zip(&line.colors).zip(&line.colors[1..]) {
            let seen = (ends[1][0] - ends[0][0]).hypot(ends[1][2] - ends[0][2]);
            let stretch = distance(ends[0], ends[1]) / seen - 1.0;
            if stretch < 1e-4 && color == next {
                assert!(color.iter().zip(dark).all(|(found, dark)| (found - dark).abs() < 1e-4), "{color:?}");
            }
            if seen > 0.1 && longest.is_none_or(|(most, _)| stretch > most) {
                longest = Some((stretch, *color));
            }
        }
    }
    let (stretch, [red, _, blue]) = longest.unwrap();
    assert!(stretch > 0.05 && red > 0.4 && blue < 0.05, "{stretch}: {red} {blue}");
}

/// The vertices of a part's triangles in the frame of its file, mm with +Z up, by a walk over its scene.
fn vertices_of_file(file: &str) -> Vec<[f64; 3]> {
    let bytes = fs::read(file).unwrap();
    let document = gltf::Gltf::from_slice(&bytes).unwrap();
    let binary = document.blob.clone().unwrap();
    let mut points = Vec::new();
    let mut open: Vec<_> =
        document.scenes().flat_map(|scene| scene.nodes()).map(|node| (node, identity())).collect();
    while let Some((node, parent)) = open.pop() {
        let here = multiplied(&parent, &node.transform().matrix());
        for primitive in node.mesh().into_iter().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let reader = primitive.reader(|_| Some(&binary));
            let place = |[x, y, z]: [f32; 3]| {
                let point = [x, y, z, 1.0].map(f64::from);
                [0, 1, 2]
                    .map(|row| (0..4).map(|column| here[column][row] * point[column]).sum::<f64>() as f32)
            };
            points.extend(reader.read_positions().unwrap().map(place).map(in_part_frame));
        }
        open.extend(node.children().map(|child| (child, here)));
    }
    points
}

type Matrix = [[f64; 4]; 4];

fn identity() -> Matrix {
    [0, 1, 2, 3].map(|column| [0, 1, 2, 3].map(|row| if row == column { 1.0 } else { 0.0 }))
}

/// The product of two matrices in columns, as in glTF.
fn multiplied(a: &Matrix, b: &[[f32; 4]; 4]) -> Matrix {
    [0, 1, 2, 3]
        .map(|column| [0, 1, 2, 3].map(|row| (0..4).map(|k| a[k][row] * f64::from(b[column][k])).sum()))
}

#[track_caller]
fn assert_same_box(found: [[f64; 3]; 2], expected: [[f64; 3]; 2], within: f64) {
    let near = found.iter().flatten().zip(expected.iter().flatten()).all(|(a, b)| (a - b).abs() <= within);
    assert!(near, "{found:?} is not {expected:?}");
}

/// Under the drawing the part follows the surface between the vertices, which is up to 0.4 mm above a coarse mesh.
#[track_caller]
fn assert_has_all(picture: &Picture, vertices: &[[f64; 3]]) {
    let shown: Vec<&[f64; 3]> = picture.node("part").triangles.iter().flatten().collect();
    for vertex in vertices {
        assert!(shown.iter().any(|point| distance(**point, *vertex) < 1e-3), "no {vertex:?}");
    }
    assert_same_box(picture.part_bounds(), bounds(vertices.iter()), 0.4);
}

#[test]
fn the_part_is_where_its_file_has_it() {
    for (file, options) in [
        ("can/fc020-gui.glb", "--facing -y --place 0,60"),
        ("can/fc020-gui.glb", "--facing +x --roll 30 --place -28,50 --set fixture.x_mm=40"),
        ("mouse/build123d.glb", "--place 0,8"),
        ("mouse/bl42-from-glb.glb", "--place 0,8"),
        ("mandarin/fc020-coarse.glb", "--facing +x --place 0,0"),
        ("assembly/fc020-gui-badge.glb", "--place 0,0"),
    ] {
        let desk = Desk::new();
        let options = format!("{options} --on-part on.glb");
        let pattern = if file.starts_with("assembly") { "ez-qr-hatch" } else { "abc" };
        let (picture, _) = picture(&desk, &[&part(file), &drawing(pattern)], &options);
        assert_has_all(&picture, &vertices_of_file(&part(file)));
    }
    // An OBJ in mm with +Z up.
    let desk = Desk::new();
    let (picture, _) = picture(&desk, &[&part("can/fc020-coarse-mesh.obj"), &drawing("abc")], CAN);
    let text = fs::read_to_string(part("can/fc020-coarse-mesh.obj")).unwrap();
    let vertex = |line: &str| -> [f64; 3] {
        let numbers: Vec<f64> = line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
        [numbers[0], numbers[1], numbers[2]]
    };
    let vertices: Vec<_> = text.lines().filter(|line| line.starts_with("v ")).map(vertex).collect();
    assert_has_all(&picture, &vertices);
}

#[test]
fn the_view_runs_along_the_border_of_the_seen_surface() {
    let desk = Desk::new();
    let (picture, _) = picture(&desk, &[&part("can/fc020-gui.glb"), &drawing("abc")], CAN);
    let view = &picture.node("view").lines;
    let [min, max] = bounds(view.iter().flat_map(|line| &line.points));
    // The laser looks along +y; the surface is seen up to 75° from its axis.
    let reach = RADIUS * 75f64.to_radians().sin();
    assert!((max[0] - reach).abs() < 1.5 && (min[0] + reach).abs() < 1.5, "{min:?} {max:?}");
    // The can is 115 mm high, with bevels that are seen as well.
    assert!(min[2] < 3.0 && max[2] > 112.0, "{min:?} {max:?}");
    assert!(view.iter().all(|line| line.points.first() == line.points.last() && line.colors.is_empty()));
}

#[test]
fn a_kept_sku_gives_the_same_picture_without_its_part() {
    let desk = Desk::new();
    let (mouse, abc) = (part("mouse/fc020-gui.glb"), drawing("abc"));
    let options = "--sku mouse --cache kept --on-part on.glb";
    let (first, _) = picture(&desk, &[&mouse, &abc], options);
    let (again, report) = picture(&desk, &[&abc], options);
    assert_eq!(report["part"]["surface_from_cache"], true);
    assert!(first.bytes == again.bytes, "the pictures differ");

    // Entries of an older version have no mesh; a damaged one is not used.
    let meshes = || -> Vec<_> {
        let files = fs::read_dir(desk.path("kept/v39/mouse")).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|ending| ending == "mesh")).collect()
    };
    assert_eq!(meshes().len(), 1);
    let without = |what: &str| {
        let output = desk.isomark(&[
            "correct",
            &abc,
            "--sku",
            "mouse",
            "--cache",
            "kept",
            "-o",
            "o.dxf",
            "--on-part",
            "on.glb",
        ]);
        output.refused(0, &["only the side that faces the laser", "name the part"]);
        let picture = Picture::of(desk.read("on.glb"));
        assert_eq!(picture.facts["part_source"], "heights", "{what}");
        let [[_, _, low], [_, _, high]] = picture.part_bounds();
        assert!(high > 30.0 && low >= 0.0, "{what}: {low} to {high}");
        assert!(first.node("mark").lines[0].points == picture.node("mark").lines[0].points, "{what}");
    };
    let mut bytes = fs::read(&meshes()[0]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&meshes()[0], bytes).unwrap();
    without("damaged");
    fs::remove_file(&meshes()[0]).unwrap();
    without("removed");
    // With the part named, the mesh is kept again.
    let (again, report) = picture(&desk, &[&mouse, &abc], options);
    assert_eq!(report["part"]["surface_from_cache"], true);
    assert!(first.bytes == again.bytes, "the pictures differ");
    assert_eq!(meshes().len(), 1);
    desk.isomark(&["cache", "remove", "mouse", "--cache", "kept"]).refused(0, &["mouse: removed"]);
    assert!(!desk.path("kept/v39/mouse").exists());
}

#[test]
fn a_primitive_is_shown_with_its_sizes() {
    let desk = Desk::new();
    let (picture, report) =
        picture(&desk, &[&drawing("abc")], "--cylinder 73,180 --place 0,0 --on-part on.glb");
    assert_eq!(
        (&picture.facts["part_source"], &picture.facts["part_triangles_of_file"]),
        (&"sizes".into(), &0.into())
    );
    // The crest is at z = 0, the axis along y.
    assert_same_box(picture.part_bounds(), [[-36.5, -90.0, -73.0], [36.5, 90.0, 0.0]], 0.02);
    for [x, _, z] in picture.node("mark").lines.iter().flat_map(|line| &line.points) {
        assert!((0.0..0.03).contains(&(x.hypot(z + 36.5) - 36.5)));
    }
    let (found, drawn) = (length(&picture.node("mark").lines), number(&report, "/quality/after/length_mm"));
    assert!((found / drawn - 1.0).abs() < 7e-4, "{found} for {drawn} mm");
}

/// Points of a can of radius 30 mm with its axis along y, 0.7 mm apart in the view from the top.
fn scanned_can() -> String {
    let mut text = String::new();
    for (row, column) in (-57..=57).flat_map(|row| (-38..=38).map(move |column| (row, column))) {
        let (x, y) = (f64::from(column) * 0.7, f64::from(row) * 0.7);
        text += &format!("{x:.4} {y:.4} {:.4}\n", (900.0 - x * x).sqrt());
    }
    text
}

#[test]
fn a_scan_is_shown_as_it_was_sampled() {
    let desk = Desk::new();
    desk.write("can.xyz", scanned_can());
    let inputs = ["can.xyz", &drawing("abc"), "--part-unit", "mm", "--place", "0,0"];
    let output = desk.isomark(&[&["correct"], &inputs[..], &["-o", "o.dxf", "--on-part", "on.glb"]].concat());
    assert!(output.code == 0 && !output.err.contains("--on-part"), "{output:?}");
    let picture = Picture::of(desk.read("on.glb"));
    assert_eq!(picture.facts["part_source"], "heights");
    for [x, _, z] in picture.node("mark").lines.iter().flat_map(|line| &line.points) {
        assert!((0.0..0.04).contains(&(x.hypot(*z) - 30.0)), "{x} {z}");
    }
    assert!(picture.node("part").triangles.len() > 1000);
    for [x, _, z] in picture.node("part").triangles.iter().flatten() {
        assert!(x.abs() > 24.0 || (x.hypot(*z) - 30.0).abs() < 0.02, "{x} {z}");
    }
}

/// A can of radius 30 mm with its axis along y, as an OBJ of two triangles for each of `around` × `along` cells.
fn large_can(around: usize, along: usize) -> String {
    let mut text = String::from("# mm\n");
    for ring in 0..=along {
        for side in 0..around {
            let angle = side as f64 / around as f64 * std::f64::consts::TAU;
            let y = ring as f64 / along as f64 * 100.0 - 50.0;
            text += &format!("v {:.5} {y:.5} {:.5}\n", 30.0 * angle.sin(), 30.0 * angle.cos());
        }
    }
    for ring in 0..along {
        for side in 0..around {
            let (a, b) = (ring * around + side + 1, ring * around + (side + 1) % around + 1);
            let (c, d) = (a + around, b + around);
            text += &format!("f {a} {b} {d}\nf {a} {d} {c}\n");
        }
    }
    text
}

#[test]
fn a_large_part_is_thinned_and_the_picture_stays_small() {
    let desk = Desk::new();
    desk.write("can.obj", large_can(400, 150));
    let options = "--part-unit mm --part-up z --place 0,0 --on-part on.glb";
    let (picture, _) = picture(&desk, &["can.obj", &drawing("abc")], options);
    assert_eq!(
        (&picture.facts["part_thinned"], &picture.facts["part_triangles_of_file"]),
        (&true.into(), &120_000.into())
    );
    let shown = number(&picture.facts, "/part_triangles") as usize;
    assert_eq!(shown, picture.node("part").triangles.len());
    assert!((8_000..=40_000).contains(&shown), "{shown}");
    assert!(picture.bytes.len() < 1_500_000, "{} bytes", picture.bytes.len());
    assert_same_box(picture.part_bounds(), [[-30.0, -50.0, -30.0], [30.0, 50.0, 30.0]], 0.5);
    // No place of the part hides the ink.
    for corner in picture.node("part").triangles.iter().flatten() {
        assert!(corner[0].hypot(corner[2]) < 30.005, "{corner:?}");
    }
}

#[test]
fn fills_and_many_lines_are_shown() {
    let desk = Desk::new();
    let badge = part("assembly/fc020-gui-badge.glb");
    let (code, _) = picture(&desk, &[&badge, &drawing("ez-qr-hatch")], "--place 0,0 --on-part on.glb");
    // The code has 424 dark modules of 0.5 mm.
    let found = area(&code.node("mark-ink").triangles);
    assert!((found - 106.0).abs() < 0.1, "{found} mm²");
    // More lines than separate primitives.
    let mut text = String::from("0\nSECTION\n2\nENTITIES\n");
    for line in 0..300 {
        let x = f64::from(line) * 0.1 - 15.0;
        text += &format!("0\nLINE\n8\n0\n10\n{x}\n20\n-5\n11\n{x}\n21\n5\n");
    }
    desk.write("lines.dxf", text + "0\nENDSEC\n0\nEOF\n");
    let (lines, report) = picture(&desk, &[&part("can/fc020-gui.glb"), "lines.dxf"], CAN);
    assert_eq!(lines.names(), ["part", "mark", "drawn", "view"], "a drawing without area");
    assert_eq!(lines.node("mark").modes, [Mode::Lines]);
    let (found, drawn) = (length(&lines.node("mark").lines), number(&report, "/quality/after/length_mm"));
    assert!((found / drawn - 1.0).abs() < 7e-4, "{found} for {drawn} mm");
}

#[test]
fn only_ink_layers_are_marked() {
    let desk = Desk::new();
    let inputs = [part("mouse/fc020-gui.glb"), drawing("ez-layers-colors")];
    let inputs = [inputs[0].as_str(), inputs[1].as_str()];
    let (all, _) = picture(&desk, &inputs, "--place 0,8 --on-part on.glb");
    let (some, report) = picture(&desk, &inputs, "--place 0,8 --on-part on.glb --ink-layers MARK");
    let (found, drawn) = (length(&some.node("mark").lines), number(&report, "/quality/after/length_mm"));
    assert!((found / drawn - 1.0).abs() < 2e-3, "{found} for {drawn} mm");
    assert!(found < length(&all.node("mark").lines));
}

#[test]
fn khronos_finds_no_fault() {
    if !khronos::is_available() {
        return;
    }
    let desk = Desk::new();
    let mut files = Vec::new();
    desk.write("dots.dxf", "0\nSECTION\n2\nENTITIES\n0\nPOINT\n8\n0\n10\n1\n20\n1\n0\nPOINT\n8\n0\n10\n3\n20\n1\n0\nENDSEC\n0\nEOF\n");
    desk.write("can.xyz", scanned_can());
    for (name, inputs, options) in [
        ("can", vec![part("can/fc020-gui.glb"), drawing("abc")], "--facing -y --place 0,60"),
        ("mouse", vec![part("mouse/fc020-coarse-mesh.obj"), drawing("ez-guilloche")], "--place 0,8"),
        (
            "mandarin",
            vec![part("mandarin/fc020-coarse.glb"), drawing("ez-logo-mm")],
            "--facing +x --place 0,0",
        ),
        ("badge", vec![part("assembly/fc020-gui-badge.glb"), drawing("ez-qr-hatch")], "--place 0,0"),
        ("cone", vec![drawing("ez-hatch-islands")], "--cone 60,85,120 --place 0,0"),
        ("dots", vec!["dots.dxf".to_owned()], "--cylinder 73,180 --place 0,0"),
        ("scan", vec!["can.xyz".to_owned(), drawing("abc")], "--part-unit mm --place 0,0"),
    ] {
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        desk.correct_to("out.dxf", &inputs, &format!("{options} --on-part {name}.glb"));
        files.push(desk.path(&format!("{name}.glb")));
    }
    for (file, verdict) in files.iter().zip(khronos::judged(&files)) {
        let issues = &verdict["issues"];
        for kind in ["numErrors", "numWarnings", "numInfos", "numHints"] {
            assert_eq!(issues[kind], 0, "{}: {issues:#}", file.display());
        }
        assert!(verdict["info"]["totalTriangleCount"].as_u64() > Some(100));
    }
}
