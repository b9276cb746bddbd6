//! The direction of a drawing on cylinders and cones: `align`, `--align`, and the angle in the report.

use serde_json::Value;

use crate::desk::{Desk, assert_near, notices, number};
use crate::frame::{ends, line};
use crate::glb::{Glb, Vector, dot};

/// A cone about the z axis, upright on z = 0, that widens by `slope` mm for each mm upwards; 0 is a can.
struct Cone {
    radius: f64,
    slope: f64,
}

impl Cone {
    fn point(&self, angle: f64, height: f64) -> Vector {
        let radius = self.radius + self.slope * height;
        [radius * angle.sin(), -radius * angle.cos(), height]
    }

    fn glb(&self) -> Vec<u8> {
        let tilt = self.slope.atan();
        let grid = Glb::default().grid("cone", None, [150, 30], |u, v| {
            let angle = std::f64::consts::TAU * u;
            let normal = [angle.sin() * tilt.cos(), -angle.cos() * tilt.cos(), -tilt.sin()];
            (self.point(angle, 110.0 * v), normal)
        });
        grid.bytes()
    }

    /// The point at the end of `s` mm that run round the axis from an angle and height, as unrolled there: on a cone that
    /// line is straight on the unrolled sector, and only touches the circle round the axis.
    fn straight_round(&self, angle: f64, height: f64, s: f64) -> Vector {
        if self.slope == 0.0 {
            return self.point(angle + s / self.radius, height);
        }
        let tilt = self.slope.atan();
        let start = (self.radius + self.slope * height) / tilt.sin();
        let (out, turn) = (start.hypot(s), s.atan2(start) / tilt.sin());
        let along = out * tilt.cos() - self.radius / self.slope;
        self.point(angle + turn, along)
    }
}

/// The view from the front, `tilt` rad from above: x to the right, y up.
struct Tilted(f64);

impl Tilted {
    fn facing(&self) -> String {
        format!("--facing=0,{},{}", -self.0.cos(), self.0.sin())
    }

    fn view(&self, point: Vector) -> [f64; 2] {
        [point[0], dot([0.0, self.0.sin(), self.0.cos()], point)]
    }
}

/// Radius, widening, tilt of the view, and angle and height of the anchor.
const PLACES: [(f64, f64, f64, f64, f64); 5] = [
    (33.0, 0.0, 0.2, 0.4, 60.0),
    (33.0, 0.0, -0.3, -0.4, 50.0),
    (40.0, 0.15, 0.2, 0.5, 60.0),
    (30.0, 0.2, 0.0, 0.4, 50.0),
    (33.0, 0.0, 0.0, 0.5, 60.0),
];

#[test]
fn the_angle_to_the_direction_round_the_axis_is_reported_and_align_removes_it() {
    for (radius, slope, tilt, angle, height) in PLACES {
        let (cone, tilted) = (Cone { radius, slope }, Tilted(tilt));
        let desk = Desk::new();
        desk.write("part.glb", cone.glb());
        desk.write("line.dxf", line());
        let [x, y] = tilted.view(cone.point(angle, height));
        let options = format!("{} --place {x},{y}", tilted.facing());
        let report = desk.correct("part.glb", "line.dxf", &options);
        // d = a·round + b·generator is horizontal in the view where d·up = 0.
        let up = [0.0, tilt.sin(), tilt.cos()];
        let round = [angle.cos(), angle.sin(), 0.0];
        let generator =
            [slope * angle.sin(), -slope * angle.cos(), 1.0].map(|value| value / slope.hypot(1.0));
        let expected = (-dot(round, up) / dot(generator, up)).atan().to_degrees();
        assert_near(&[number(&report, "/placement/round/angle_deg")], &[expected], 0.01);
        assert_eq!(number(&report, "/placement/round/turned_deg"), 0.0);
        let is_askew = expected.abs() > 0.5;
        assert_eq!(
            notices(&report).contains(&"drawing-askew"),
            is_askew,
            "{expected}: {:?}",
            notices(&report)
        );

        let report = desk.correct("part.glb", "line.dxf", &format!("{options} --align axis"));
        assert_near(&[number(&report, "/placement/round/angle_deg")], &[0.0], 1e-3);
        assert_near(&[number(&report, "/placement/round/turned_deg")], &[-expected], 0.01);
        assert!(!notices(&report).contains(&"drawing-askew"));
        let true_ends = [-15.0, 15.0].map(|s| tilted.view(cone.straight_round(angle, height, s)));
        assert_near(ends(&desk.read("out.dxf")).as_flattened(), true_ends.as_flattened(), 0.02);
        // A turn that a person gives is meant, and is added.
        let report = desk.correct("part.glb", "line.dxf", &format!("{options} --align axis --rotate 30"));
        assert_near(&[number(&report, "/placement/round/angle_deg")], &[30.0], 0.01);
        assert!(!notices(&report).contains(&"drawing-askew"));
    }
}

#[test]
fn a_part_without_an_axis_is_placed_as_in_the_view() {
    let desk = Desk::new();
    let dome = Glb::default().grid("dome", None, [40, 40], |u, v| {
        let [x, y] = [80.0 * u - 40.0, 80.0 * v - 40.0];
        let z = (90.0f64.powi(2) - x * x - y * y).sqrt();
        ([x, y, z], [x / 90.0, y / 90.0, z / 90.0])
    });
    desk.write("dome.glb", dome.bytes());
    desk.write("line.dxf", line());
    let plain = desk.correct("dome.glb", "line.dxf", "");
    let before = ends(&desk.read("out.dxf"));
    let report = desk.correct("dome.glb", "line.dxf", "--align axis");
    assert!(notices(&report).contains(&"align-without-axis"), "{:?}", notices(&report));
    assert!(plain["placement"].get("round").is_none() && !notices(&plain).contains(&"align-without-axis"));
    assert_near(ends(&desk.read("out.dxf")).as_flattened(), before.as_flattened(), 1e-12);
}

/// A cylinder given by its sizes has an axis, too, whichever way it is turned.
#[test]
fn a_cylinder_given_by_its_sizes_is_aligned() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    for (axis, expected) in [("y", 0.0), ("x", 90.0), ("0.2,1,0", -(0.2f64.atan().to_degrees()))] {
        let options = format!("--cylinder 66,110 --axis={axis} --align axis");
        let arguments = ["correct", "line.dxf", "--out", "out.dxf", "--json"];
        let options: Vec<&str> = arguments.into_iter().chain(options.split(' ')).collect();
        let output = desk.isomark(&options);
        assert_eq!(output.code, 0, "{}", output.err);
        let report: Value = serde_json::from_str(&output.out).unwrap();
        assert_near(&[number(&report, "/placement/round/turned_deg")], &[expected], 1e-6);
        assert_near(&[number(&report, "/placement/round/angle_deg")], &[0.0], 1e-6);
    }
}
