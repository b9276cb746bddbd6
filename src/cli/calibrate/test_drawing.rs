//! The drawing by which a lens is measured: a grid of crosses with their names, and the tables to fill in.

use std::fmt::Write;

use crate::formats::pattern::{PatternOptions, read};
use crate::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::pattern::{Path, Segment, Shape};
use crate::geometry::space::{Extents, FieldPoint, FlatPoint};

/// The outer crosses stand at this share of the field from its middle.
const REACH: f64 = 0.4;
/// Half the length of a cross's arms, in shares of the shorter side of the field.
const ARM: f64 = 0.03;
/// Height of the letters, in shares of the shorter side of the field.
const LETTERS: f64 = 0.025;

/// A cross of the grid.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cross {
    /// Column as a letter from the left, row as a number from below, such as `B2`.
    pub(super) name: String,
    pub(super) at: FieldPoint,
}

/// The crosses of a grid with `count` × `count` of them, row by row from below.
pub(super) fn crosses(field: &Extents, count: usize) -> Vec<Cross> {
    let share = |index: usize| REACH * (2.0 * index as f64 / (count - 1) as f64 - 1.0);
    let cross = |row: usize, column: usize| {
        let letter = char::from(b'A' + column as u8);
        let beside = field.size().component_mul(&nalgebra::Vector2::new(share(column), share(row)));
        let at = field.center() + beside;
        // Positions that people can compare with a ruler.
        let rounded = at.map(|value| (value * 1000.0).round() / 1000.0 + 0.0);
        Cross { name: format!("{letter}{}", row + 1), at: rounded.into() }
    };
    (0..count).flat_map(|row| (0..count).map(move |column| cross(row, column))).collect()
}

/// The pairs of crosses whose distances are worth measuring: the ends of the outer rows and columns, and both diagonals.
pub(super) fn pairs(count: usize) -> Vec<[usize; 2]> {
    let last = count - 1;
    let at = |row: usize, column: usize| row * count + column;
    let mut rows = vec![0, last / 2, last];
    rows.dedup();
    let along = rows.iter().flat_map(|&line| [[at(line, 0), at(line, last)], [at(0, line), at(last, line)]]);
    along.chain([[at(0, 0), at(last, last)], [at(0, last), at(last, 0)]]).collect()
}

/// The drawing for the plate at height `z`, mm.
pub(super) fn drawing(field: &Extents, crosses: &[Cross], z: f64) -> MarkingDrawing {
    let side = field.size().min();
    let (arm, letters) = (ARM * side, LETTERS * side);
    let mut text =
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    let mut line = |from: [f64; 2], to: [f64; 2]| {
        let _ = write!(
            text,
            "0\nLINE\n8\nCROSSES\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n",
            from[0], from[1], to[0], to[1]
        );
    };
    for Cross { at, .. } in crosses {
        line([at.x - arm, at.y], [at.x + arm, at.y]);
        line([at.x, at.y - arm], [at.x, at.y + arm]);
    }
    let mut label = |x: f64, y: f64, words: &str| {
        let _ = write!(text, "0\nTEXT\n8\nLABELS\n10\n{x}\n20\n{y}\n40\n{letters}\n1\n{words}\n");
    };
    for Cross { at, name } in crosses {
        label(at.x + arm / 3.0, at.y + arm / 3.0, name);
    }
    let middle = field.center();
    label(middle.x + arm / 3.0, middle.y - arm - 2.0 * letters, &format!("z = {z} mm"));
    text += "0\nENDSEC\n0\nEOF\n";
    let pattern = read(text.as_bytes(), &PatternOptions::default().strictly(true));
    let pattern = pattern.map(|reading| reading.pattern).unwrap_or_default();
    let paths = pattern.paths.iter().map(marked).collect();
    MarkingDrawing {
        layers: pattern.layers,
        paths,
        comments: vec![format!("isomark lens test, plate at {z} mm")],
    }
}

/// A path of a drawing that is marked as it is drawn.
fn marked(path: &Path) -> MarkingPath {
    let field = |at: FlatPoint| FieldPoint::from(at.coords());
    let points = |segments: &[Segment]| {
        let starts = segments.iter().take(1).map(Segment::start);
        let along = segments.iter().flat_map(|segment| {
            let steps = segment.steps(0.01);
            (1..=steps).map(move |step| segment.point(step as f64 / steps as f64))
        });
        starts.chain(along).map(field).collect::<Vec<_>>()
    };
    let shape = match &path.shape {
        Shape::Dot(at) => MarkingShape::Dot(field(*at)),
        Shape::Open(segments) => MarkingShape::Open(points(segments)),
        Shape::Closed(segments) => {
            let mut points = points(segments);
            points.pop();
            MarkingShape::Closed(points)
        }
    };
    MarkingPath { layer: path.layer, color: path.color, shape }
}

/// The table of positions, with empty cells for the measured ones.
pub(super) fn positions_table(crosses: &[Cross], heights: &[f64]) -> String {
    let mut table = "sep=;\ncross;height_mm;x_mm;y_mm;measured_x_mm;measured_y_mm\n".to_owned();
    for z in heights {
        for Cross { name, at } in crosses {
            let _ = writeln!(table, "{name};{z};{};{};;", at.x, at.y);
        }
    }
    table
}

/// The table of distances, with empty cells for the measured ones.
pub(super) fn distances_table(crosses: &[Cross], heights: &[f64], count: usize) -> String {
    let mut table = "sep=;\nheight_mm;from;to;from_x_mm;from_y_mm;to_x_mm;to_y_mm;measured_mm\n".to_owned();
    for z in heights {
        for [from, to] in pairs(count).into_iter().map(|pair| pair.map(|index| &crosses[index])) {
            let ([a, b], [c, d]) = ([from.at.x, from.at.y], [to.at.x, to.at.y]);
            let _ = writeln!(table, "{z};{};{};{a};{b};{c};{d};", from.name, to.name);
        }
    }
    table
}
