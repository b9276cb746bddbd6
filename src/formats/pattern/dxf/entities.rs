//! Reads entities as curves in the space of the block that contains them.

use nalgebra::Vector3;

use super::super::error::PatternReadError;
use super::budget::Budget;
use super::curves::{Curve, Placement, SpaceSegment, arc, is_full_turn, sweep_between, through};
use super::groups::{Groups, embedded};
use super::items::{Grid, Insert, Item, Reader, Remarks};
use super::scan::{Kind, kind_of};
use super::splines::{ControlSpline, by_control_points, through_fit_points};
use super::structure::{PointMode, Record};
use super::{hatch, polylines, text};

impl Reader<'_> {
    /// What the entities of blocks draw, in the order of the inventory; nothing for entities outside blocks.
    ///
    /// # Errors
    /// When a number of an entity cannot be read or is not finite, or the budget is exceeded.
    pub(super) fn block_items(
        &self,
        remarks: &mut Remarks,
        budget: &mut Budget,
    ) -> Result<Vec<Item>, PatternReadError> {
        let mut drawn = self.structure.drawn.iter().cloned().flatten().peekable();
        // The entities after the last block, in most drawings nearly all, are outside blocks.
        let last = self.structure.blocks.values().map(|block| block.entities.end).max().unwrap_or(0);
        let item = |index| match drawn.next_if_eq(&index) {
            Some(_) => Ok(Item::Template),
            None => self.item(index, remarks, budget),
        };
        (0..last).map(item).collect()
    }

    /// What an entity of the inventory draws; nothing if it does not exist.
    ///
    /// # Errors
    /// When one of its numbers cannot be read or is not finite, or the budget is exceeded.
    pub(super) fn item(
        &self,
        index: usize,
        remarks: &mut Remarks,
        budget: &mut Budget,
    ) -> Result<Item, PatternReadError> {
        let Some(record) = self.structure.entities.get(index) else { return Ok(Item::Template) };
        budget.begin_entity();
        // Every entity spends one; entities with many pieces spend as many more.
        let item = match budget.hold(1) {
            Ok(()) => self.read(index, record, remarks, budget)?,
            Err(exceeded) => Item::Skipped(exceeded.into()),
        };
        match budget.exceeded() {
            Some(cost) => Err(cost.too_many(self.structure.name(self.scan, record))),
            None => Ok(item),
        }
    }

    fn read(
        &self,
        index: usize,
        record: &Record,
        remarks: &mut Remarks,
        budget: &mut Budget,
    ) -> Result<Item, PatternReadError> {
        let groups = |codes: &[i32]| {
            let (scan, structure) = (self.scan, self.structure);
            Groups::read(scan, structure, record, record.pairs(scan), |code| codes.contains(&code))
        };
        Ok(match self.structure.kind(record) {
            "LINE" | "3DLINE" => {
                let line = groups(&[10, 20, 30, 11, 21, 31])?;
                Item::Curve(through(&[line.point(10), line.point(11)], false))
            }
            "POINT" if self.structure.header.points == PointMode::Hidden => {
                Item::Unseen("the drawing shows no points ($PDMODE is 1): set it to 0 to mark them as dots")
            }
            "POINT" => Item::Dot(groups(&[10, 20, 30])?.point(10)),
            "CIRCLE" => {
                let circle = groups(&[10, 20, 30, 40, 210, 220, 230])?;
                round(circle.or(40, 0.0), |radius| {
                    arc(circle.point(10), radius, 0.0, std::f64::consts::TAU, &circle.plane())
                })
            }
            "ARC" => {
                let part = groups(&[10, 20, 30, 40, 50, 51, 210, 220, 230])?;
                let (start, end) = (part.or(50, 0.0).to_radians(), part.or(51, 360.0).to_radians());
                let sweep = sweep_between(start, end);
                round(part.or(40, 0.0), |radius| arc(part.point(10), radius, start, sweep, &part.plane()))
            }
            "ELLIPSE" => ellipse(&groups(&[10, 20, 30, 11, 21, 31, 40, 41, 42, 210, 220, 230])?),
            kind @ ("LWPOLYLINE" | "POLYLINE") => {
                let line = match kind {
                    "POLYLINE" => polylines::heavy(self, record, budget)?,
                    _ => polylines::light(self, index, record, remarks, budget)?,
                };
                if matches!(line, Item::Wide(_)) {
                    remarks.wide.insert(index);
                }
                line
            }
            // A helix is stored as a spline, followed by the data of its axis.
            kind @ ("SPLINE" | "HELIX") => {
                let (scan, structure) = (self.scan, self.structure);
                let pairs = record.pairs(scan);
                let helix = pairs.iter().position(|pair| scan.is(pair, 100, b"AcDbHelix"));
                let own = &pairs[..helix.filter(|_| kind == "HELIX").unwrap_or(pairs.len())];
                let wanted = |code| {
                    matches!(code % 10, 0..=3) && (10..=33).contains(&code)
                        || matches!(code, 40 | 41 | 70 | 71)
                };
                spline(&Groups::read(scan, structure, record, own, wanted)?, self.tolerance, budget)
            }
            "SOLID" | "TRACE" => {
                let solid = groups(&[10, 20, 30, 11, 21, 31, 12, 22, 32, 13, 23, 33, 39, 210, 220, 230])?;
                quadrangle(&solid)
            }
            "INSERT" => {
                let insert = groups(&[10, 20, 30, 41, 42, 43, 44, 45, 50, 70, 71, 210, 220, 230])?;
                Item::Insert(Box::new(self.insert(&insert, record)))
            }
            "HATCH" | "MPOLYGON" => {
                let (scan, structure) = (self.scan, self.structure);
                let is_number =
                    |code| matches!(kind_of(code), Some(Kind::Double | Kind::Short | Kind::Integer));
                let pairs = record.pairs(scan);
                // In front of this mark, 92 is the size of a preview, and not the flags of a boundary.
                let mark = pairs.iter().position(|pair| {
                    [&b"AcDbHatch"[..], b"AcDbMPolygon"].iter().any(|class| scan.is(pair, 100, class))
                });
                let own = &pairs[mark.unwrap_or(0)..];
                let numbers = Groups::read(scan, structure, record, own, is_number)?;
                if numbers.flags(450) != 0 {
                    remarks.gradients.insert(index);
                }
                hatch::hatch(&numbers.0, self.tolerance, budget)
            }
            "DIMENSION" | "ARC_DIMENSION" | "LARGE_RADIAL_DIMENSION" => {
                self.dimension(&groups(&[12, 22, 32, 210, 220, 230])?, record)
            }
            kind @ ("TEXT" | "ATTRIB" | "ATTDEF" | "MTEXT") => {
                let uses = remarks.texts.entry(index).or_default();
                let found = (uses, remarks.fields.entry(index).or_default());
                let paragraphs = matches!(kind, "ATTRIB" | "ATTDEF")
                    .then(|| embedded(self.scan, record.pairs(self.scan)))
                    .flatten();
                match (kind, paragraphs) {
                    ("MTEXT", _) => text::paragraphs::drawn(self, record, found, budget)?,
                    (_, Some(pairs)) => text::paragraphs::embedded(self, record, pairs, found, budget)?,
                    (_, None) => text::single_line(self, record, found, budget)?,
                }
            }
            "VIEWPORT" => Item::DrawsNothing("it is a viewport of a layout"),
            "LIGHT" | "CAMERA" => Item::DrawsNothing("it is not plotted"),
            "SEQEND" => Item::DrawsNothing("it does not belong to a polyline or a block"),
            "RAY" | "XLINE" => Item::Unseen("it is infinite: trim it to a line"),
            kind => Item::Skipped(why_not(kind).into()),
        })
    }

    fn block_name(&self, record: &Record) -> String {
        let name = super::groups::own(self.scan, record.pairs(self.scan)).find(|pair| pair.code == 2);
        name.map(|pair| self.scan.text(pair)).unwrap_or_default()
    }

    fn insert(&self, insert: &Groups, record: &Record) -> Insert {
        let plane = insert.plane();
        let angle = insert.or(50, 0.0).to_radians();
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        let turned = plane.linear * turn.matrix();
        let scale = Vector3::new(insert.or(41, 1.0), insert.or(42, 1.0), insert.or(43, 1.0));
        Insert {
            block: self.block_name(record),
            placement: Placement {
                linear: turned * nalgebra::Matrix3::from_diagonal(&scale),
                offset: plane.point(insert.point(10)),
            },
            grid: Grid {
                columns: insert.count(70, 1),
                rows: insert.count(71, 1),
                column_step: turned * Vector3::x() * insert.or(44, 0.0),
                row_step: turned * Vector3::y() * insert.or(45, 0.0),
            },
        }
    }

    /// A dimension is drawn through a block that the drawing program made for it. Group 12 is the offset of a copy.
    fn dimension(&self, dimension: &Groups, record: &Record) -> Item {
        let block = self.block_name(record);
        if block.is_empty() {
            return Item::Skipped("it has no block with its lines: explode it in the drawing program".into());
        }
        let plane = dimension.plane();
        Item::Insert(Box::new(Insert {
            block,
            placement: Placement { linear: plane.linear, offset: plane.point(dimension.point(12)) },
            grid: Grid::single(),
        }))
    }
}

fn round(radius: f64, curve: impl FnOnce(f64) -> Curve) -> Item {
    if radius == 0.0 { Item::DrawsNothing("its radius is 0") } else { Item::Curve(curve(radius)) }
}

fn ellipse(ellipse: &Groups) -> Item {
    let major = ellipse.point(11);
    let normal = ellipse.plane().linear.column(2).into_owned();
    let (start, end) = (ellipse.or(41, 0.0), ellipse.or(42, std::f64::consts::TAU));
    let sweep = sweep_between(start, end);
    let (center, v) = (ellipse.point(10), normal.cross(&major) * ellipse.or(40, 1.0));
    let segment = SpaceSegment::Arc { center, u: major, v, start, sweep };
    round(major.norm(), |_| Curve { segments: vec![segment], closed: is_full_turn(sweep) })
}

fn spline(spline: &Groups, tolerance: f64, budget: &mut Budget) -> Item {
    let closed = spline.flags(70) & 1 == 1;
    let points = spline.points(10);
    let curve = if points.is_empty() {
        let through = spline.points(11);
        if through.windows(2).all(|pair| pair[0] == pair[1]) {
            return Item::DrawsNothing("it has fewer than two different points");
        }
        let direction = |code| Some(spline.point(code)).filter(|tangent| tangent.norm() > 0.0);
        through_fit_points(&through, closed, [direction(12), direction(13)], budget)
    } else {
        let control = ControlSpline {
            degree: usize::try_from(spline.flags(71)).unwrap_or(0),
            knots: &spline.all(40),
            points: &points,
            weights: &spline.all(41),
            closed,
        };
        by_control_points(&control, tolerance, budget)
    };
    curve.map_or_else(|why| Item::Skipped(why.into()), Item::Curve)
}

fn quadrangle(solid: &Groups) -> Item {
    // The corners of a SOLID are stored row by row, not in circular order; a triangle repeats the third or has no
    // fourth.
    let fourth = if solid.get(13).is_some() { 13 } else { 12 };
    let plane = solid.plane();
    let mut corners: Vec<Vector3<f64>> =
        [10, 11, fourth, 12].iter().map(|code| plane.point(solid.point(*code))).collect();
    corners.dedup();
    if corners.len() < 3 {
        return Item::DrawsNothing("it has no area");
    }
    Item::Fill(vec![through(&corners, true)])
}

/// Why an entity of an unsupported type is skipped, and what to do.
fn why_not(kind: &str) -> &'static str {
    match kind {
        "RTEXT" | "ARCALIGNEDTEXT" | "SHAPE" | "TOLERANCE" => {
            "this type of text is not supported: convert it to outlines in the drawing program"
        }
        "3DFACE" | "3DSOLID" | "BODY" | "REGION" | "SURFACE" | "MESH" | "PLANESURFACE"
        | "EXTRUDEDSURFACE" | "LOFTEDSURFACE" | "REVOLVEDSURFACE" | "SWEPTSURFACE" => {
            "it is a surface or a solid, not a curve: draw its outline"
        }
        "LEADER" | "MULTILEADER" | "MLEADER" | "MLINE" | "ACAD_TABLE" => {
            "its look depends on styles that are not supported: explode it in the drawing program"
        }
        "IMAGE" | "OLEFRAME" | "OLE2FRAME" | "PDFUNDERLAY" | "DWFUNDERLAY" | "DGNUNDERLAY" => {
            "pictures in a DXF file are not marked: trace them to curves"
        }
        "WIPEOUT" => {
            "it hides lines behind it, which would be marked: trim these lines, and delete the wipeout"
        }
        "VERTEX" => "it does not belong to a polyline: draw the polyline again",
        _ => "this type of entity is not supported: explode it in the drawing program",
    }
}
