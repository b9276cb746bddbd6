//! The numbers of an entity: only the groups needed for its type, all finite.

use nalgebra::Vector3;

use super::super::error::PatternReadError;
use super::curves::Placement;
use super::scan::{EMBEDDED, Pair, Scan};
use super::structure::{Record, Structure};

/// The needed numbers of one entity, in file order with their group codes.
pub(super) struct Groups(pub(super) Vec<(i32, f64)>);

impl Groups {
    /// The numbers of `pairs` whose group codes are `wanted`. Groups in braces belong to other programs, and so does
    /// everything after the first application name (1001).
    ///
    /// # Errors
    /// When a wanted number cannot be read or is not finite.
    pub(super) fn read(
        scan: &Scan<'_>,
        structure: &Structure,
        record: &Record,
        pairs: &[Pair],
        wanted: impl Fn(i32) -> bool,
    ) -> Result<Self, PatternReadError> {
        Self::of(scan, structure, record, own(scan, pairs).filter(|pair| wanted(pair.code)))
    }

    /// The numbers of these pairs.
    ///
    /// # Errors
    /// When one of them cannot be read or is not finite.
    pub(super) fn of<'p>(
        scan: &Scan<'_>,
        structure: &Structure,
        record: &Record,
        pairs: impl Iterator<Item = &'p Pair>,
    ) -> Result<Self, PatternReadError> {
        let mut numbers = Vec::with_capacity(pairs.size_hint().1.unwrap_or(0));
        for pair in pairs {
            let number = scan.number(pair).ok_or_else(|| PatternReadError::UnreadableNumber {
                spot: scan.spot(pair),
                group: pair.code,
                text: scan.shown(pair),
                entity: structure.name(scan, record),
            })?;
            numbers.push((pair.code, number));
        }
        Ok(Self(numbers))
    }

    /// The last number with this code.
    pub(super) fn get(&self, code: i32) -> Option<f64> {
        self.0.iter().rev().find(|group| group.0 == code).map(|group| group.1)
    }

    pub(super) fn or(&self, code: i32, default: f64) -> f64 {
        self.get(code).unwrap_or(default)
    }

    /// The last number with this code as bits; 0 if there is none.
    pub(super) fn flags(&self, code: i32) -> i64 {
        self.or(code, 0.0) as i64
    }

    /// A number of copies or vertices: at least `least`.
    pub(super) fn count(&self, code: i32, least: usize) -> usize {
        (self.or(code, 0.0) as usize).max(least)
    }

    /// The point with the codes `code`, `code + 10` and `code + 20`; missing coordinates are 0.
    pub(super) fn point(&self, code: i32) -> Vector3<f64> {
        Vector3::new(self.or(code, 0.0), self.or(code + 10, 0.0), self.or(code + 20, 0.0))
    }

    /// All points with these codes; each starts with `code`.
    pub(super) fn points(&self, code: i32) -> Vec<Vector3<f64>> {
        let mut points: Vec<Vector3<f64>> = Vec::new();
        for (found, number) in &self.0 {
            match (found - code, points.last_mut()) {
                (0, _) => points.push(Vector3::new(*number, 0.0, 0.0)),
                (10, Some(point)) => point.y = *number,
                (20, Some(point)) => point.z = *number,
                _ => {}
            }
        }
        points
    }

    /// All numbers with this code.
    pub(super) fn all(&self, code: i32) -> Vec<f64> {
        self.0.iter().filter(|group| group.0 == code).map(|group| group.1).collect()
    }

    /// The plane of the entity's OCS, from its extrusion direction (210).
    pub(super) fn plane(&self) -> Placement {
        match self.get(210).or(self.get(220)).or(self.get(230)) {
            Some(_) => Placement::of_extrusion(self.point(210)),
            None => Placement::scaling(1.0),
        }
    }
}

/// The pairs of the entity, without the one with its type and without the groups of other programs.
pub(super) fn own<'p>(scan: &'p Scan<'_>, pairs: &'p [Pair]) -> impl Iterator<Item = &'p Pair> {
    let mut in_braces = false;
    // In an embedded object, such as the columns of an MTEXT, the codes have other meanings.
    pairs.iter().skip(1).take_while(|pair| pair.code < 1000 && pair.code != EMBEDDED).filter(move |pair| {
        let braces = pair.code == 102;
        if braces {
            in_braces = scan.raw(pair).starts_with(b"{");
        }
        !braces && !in_braces
    })
}

/// The pairs of the entity's embedded object, such as the paragraphs of an ATTRIB; `None` if it has none. The first one is its mark.
pub(super) fn embedded<'p>(scan: &Scan<'_>, pairs: &'p [Pair]) -> Option<&'p [Pair]> {
    let end = pairs.iter().position(|pair| pair.code >= 1000).unwrap_or(pairs.len());
    let start = pairs[..end].iter().position(|pair| scan.is(pair, EMBEDDED, b"Embedded Object"))?;
    Some(&pairs[start..end])
}
