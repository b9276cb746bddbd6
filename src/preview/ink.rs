//! The drawn lines: divided into runs of one colour, and thinned if there are more segments than a picture can show.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use super::page::PathData;
use super::stretch_scale::{Shade, StretchScale};
use super::{PreviewPath, grid_cell};

/// Maximum number of segments in a picture; beyond it neighbours are joined, because no screen can resolve them.
const MAX_SEGMENTS: usize = 200_000;

/// Coordinates beyond this, mm, are treated as damaged: no part is a kilometre long.
const MAX_COORDINATE: f64 = 1e6;

/// A connected line with the stretch of each segment: there is one more point than stretches. A dot has one point.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line<const AXES: usize = 2> {
    pub(super) points: Vec<[f64; AXES]>,
    pub(super) stretch: Vec<f64>,
}

/// The paths as connected lines, split where a coordinate is not finite; missing stretches are unknown.
pub(super) fn lines<const AXES: usize>(paths: &[PreviewPath<AXES>]) -> Vec<Line<AXES>> {
    let mut lines = Vec::new();
    for path in paths {
        let closing = path.points.first().filter(|first| path.closed && path.points.last() != Some(first));
        let mut line = Line { points: Vec::new(), stretch: Vec::new() };
        for (index, point) in path.points.iter().chain(closing).enumerate() {
            if !point.iter().all(|coordinate| coordinate.abs() <= MAX_COORDINATE) {
                lines.push(std::mem::replace(&mut line, Line { points: Vec::new(), stretch: Vec::new() }));
                continue;
            }
            if !line.points.is_empty() {
                line.stretch.push(path.stretch.get(index - 1).copied().unwrap_or(f64::NAN));
            }
            line.points.push(*point);
        }
        lines.push(line);
    }
    lines.retain(|line| !line.points.is_empty());
    lines
}

/// Length in mm and stretch of every segment.
pub(super) fn weighted<const AXES: usize>(lines: &[Line<AXES>]) -> impl Iterator<Item = (f64, f64)> {
    lines.iter().flat_map(|line| {
        line.points
            .windows(2)
            .zip(&line.stretch)
            .map(|(ends, stretch)| (distance(ends[0], ends[1]), *stretch))
    })
}

/// One path of SVG data for each colour, with the runs of consecutive segments in that colour.
pub(super) fn runs(lines: &[Line], scale: &StretchScale) -> BTreeMap<Shade, PathData> {
    let mut runs: BTreeMap<Shade, PathData> = BTreeMap::new();
    for line in thinned(lines, MAX_SEGMENTS).iter() {
        if line.stretch.is_empty() {
            runs.entry(Some(0)).or_default().polyline(&line.points);
        }
        let mut start = 0;
        while start < line.stretch.len() {
            let shade = scale.shade(line.stretch[start]);
            let same = line.stretch[start..].iter().take_while(|stretch| scale.shade(**stretch) == shade);
            let end = start + same.count();
            runs.entry(shade).or_default().polyline(&line.points[start..=end]);
            start = end;
        }
    }
    runs
}

/// All lines in one path of SVG data, without colour.
pub(super) fn outline(lines: &[Line]) -> PathData {
    let mut outline = PathData::default();
    thinned(lines, MAX_SEGMENTS).iter().for_each(|line| outline.polyline(&line.points));
    outline
}

/// The lines with neighbouring segments joined until at most `most` are left.
pub(super) fn thinned<const AXES: usize>(lines: &[Line<AXES>], most: usize) -> Cow<'_, [Line<AXES>]> {
    let segments = |lines: &[Line<AXES>]| lines.iter().map(|line| line.stretch.len().max(1)).sum::<usize>();
    if segments(lines) <= most {
        return Cow::Borrowed(lines);
    }
    let total_length = weighted(lines).map(|(length, _)| length).sum::<f64>();
    // Joining has an effect from chords of the total length divided by the number of segments; dots have no length.
    let mut chord = (total_length / most as f64).max(1e-4);
    loop {
        let joined = joined(lines, chord);
        if segments(&joined) <= most {
            return Cow::Owned(joined);
        }
        chord *= 2.0;
    }
}

/// The lines with segments of at least `chord` mm; short lines at the same place are drawn once.
fn joined<const AXES: usize>(lines: &[Line<AXES>], chord: f64) -> Vec<Line<AXES>> {
    let mut seen = BTreeSet::new();
    let mut joined = Vec::new();
    for line in lines {
        let mut short = Line { points: vec![line.points[0]], stretch: Vec::new() };
        let (mut length, mut weighted_stretch) = (0.0, 0.0);
        for (index, stretch) in line.stretch.iter().enumerate() {
            let (from, to) = (line.points[index], line.points[index + 1]);
            let step = distance(from, to);
            length += step;
            weighted_stretch += step * stretch;
            let is_last = index + 1 == line.stretch.len();
            let start = short.points[short.points.len() - 1];
            if is_last || distance(start, to) >= chord {
                short.stretch.push(if length > 0.0 { weighted_stretch / length } else { *stretch });
                short.points.push(to);
                (length, weighted_stretch) = (0.0, 0.0);
            }
        }
        let ends = [short.points[0], short.points[short.points.len() - 1]].map(|end| grid_cell(end, chord));
        if short.points.len() > 2 || seen.insert(ends) {
            joined.push(short);
        }
    }
    joined
}

fn distance<const AXES: usize>(a: [f64; AXES], b: [f64; AXES]) -> f64 {
    let mut square = 0.0;
    for axis in 0..AXES {
        square += (b[axis] - a[axis]) * (b[axis] - a[axis]);
    }
    square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(points: Vec<[f64; 2]>, closed: bool, stretch: Vec<f64>) -> PreviewPath {
        PreviewPath { points, closed, stretch }
    }

    #[test]
    fn a_contour_returns_to_its_start() {
        let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let lines = lines(&[path(square, true, vec![0.0, 0.1, 0.1])]);
        assert_eq!(lines[0].points.len(), 5);
        assert_eq!(lines[0].stretch[..3], [0.0, 0.1, 0.1]);
        assert!(lines[0].stretch[3].is_nan(), "a missing stretch is unknown");
    }

    #[test]
    fn a_point_that_is_not_a_number_splits_the_line() {
        let points = vec![[0.0, 0.0], [1.0, 0.0], [f64::NAN, 0.0], [3.0, 0.0], [4.0, 0.0]];
        let lines = lines(&[path(points, false, vec![0.1, 0.2, 0.3, 0.4])]);
        assert_eq!(lines.iter().map(|line| line.stretch.clone()).collect::<Vec<_>>(), [[0.1], [0.4]]);
    }

    #[test]
    fn neighbours_of_one_colour_become_one_run() {
        let points = (0..5).map(|x| [f64::from(x), 0.0]).collect();
        let lines = lines(&[path(points, false, vec![0.0, 0.001, 0.1, 0.1])]);
        let runs = runs(&lines, &StretchScale { limit: 0.1, exceeded: false });
        let texts: Vec<_> = runs.iter().map(|(shade, data)| (*shade, data.text())).collect();
        assert_eq!(texts, [(Some(0), "m0 0l1 0l1 0"), (Some(10), "m2 0l1 0l1 0")]);
    }

    #[test]
    fn too_many_segments_are_joined() {
        let spiral = |index: i32| {
            let angle = f64::from(index) * 1e-3;
            [angle * angle.cos() / 30.0, angle * angle.sin() / 30.0]
        };
        let one = path((0..=500_000).map(spiral).collect(), false, vec![0.05; 500_000]);
        let dots = (0..300_000).map(|index| path(vec![spiral(index)], false, Vec::new()));
        for paths in [vec![one], dots.collect()] {
            let all = lines(&paths);
            let lines = thinned(&all, MAX_SEGMENTS);
            let segments: usize = lines.iter().map(|line| line.stretch.len().max(1)).sum();
            assert!(segments <= MAX_SEGMENTS && segments > MAX_SEGMENTS / 20, "{segments}");
            assert!(weighted(&lines).all(|(_, stretch)| (stretch - 0.05).abs() < 1e-9));
        }
    }
}
