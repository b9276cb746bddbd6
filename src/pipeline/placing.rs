//! Placing a drawing on a part: where its anchor lands, which way it is turned, and the map that follows.

use super::content::{self, PlacedCode};
use super::fill;
use super::map_method::method;
use super::progress::Steps;
use super::recent::RecentDrawings;
use super::{
    Clock, LearnedPart, PatternInput, Pipeline, PipelineError, QUICK_WORK, Step, WORK_OF_PIECE, checks,
    suggested_place,
};
use crate::cache::CachedSurface;
use crate::config::{Align, Anchor, JobSettings, Sku, Tiles, ViewSource};
use crate::cores::Cores;
use crate::formats::pattern::{self, PatternFacts, PatternOptions, PatternReadError, PatternReading};
use crate::geometry::ink::Ink;
use crate::geometry::mapping::quality;
use crate::geometry::mapping::{LengthTrueMap, MapError, is_on_part};
use crate::geometry::pattern::{Affine, Pattern};
use crate::geometry::space::FlatPoint;
use crate::geometry::surface::fit::FittedSurface;
use crate::reason::{Notice, Reason};
use crate::report::{FrameReport, FrameSource, PlacementReport, RoundReport};

/// A placed drawing.
#[derive(Clone)]
pub(super) struct PlacedPattern {
    pub(super) facts: PatternFacts,
    pub(super) placing: Placing,
    pub(super) placed: Pattern,
    pub(super) ink: Ink,
}

impl Pipeline {
    /// The settings for a part whose file may contain a marking frame, with the notices about them.
    pub(super) fn framed(
        settings: &JobSettings,
        sku: &Sku,
        part: &CachedSurface,
        notices: &mut Vec<Notice>,
    ) -> JobSettings {
        let of_file = part.facts.marking_frame().filter(|_| settings.part.primitive.is_none());
        notices.extend(checks::frame_of_file(of_file.as_ref(), settings));
        let mut settings = JobSettings { part: settings.part.for_part_with(of_file), ..settings.clone() };
        settings.content.values = settings.content.values_of(sku.as_str());
        let frame = settings.part.view_source.frame();
        notices.extend(checks::flat_side(&part.facts, &settings.part));
        notices.extend(frame.and_then(|frame| checks::frame_on_surface(frame, part, &settings.part)));
        settings
    }

    /// The map of a placed drawing from the file `name` on the part round it, of the `whole` part. The drawing is turned along the
    /// axis of a cylinder or cone first if the settings ask for that.
    ///
    /// # Errors
    /// When there is no map, or the turned drawing has ink where no part can be.
    pub(super) fn mapped(
        pattern: PlacedPattern,
        learned: &LearnedPart,
        whole: &LearnedPart,
        settings: &JobSettings,
        name: &str,
    ) -> Result<(PlacedPattern, LengthTrueMap), PipelineError> {
        let part = &learned.kept;
        let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
        let method = method(settings);
        let rejected = |reason: Reason, facts: &PatternFacts, placed: &Pattern| {
            let reason = suggested_place::suggesting_place(reason, placed, &whole.kept, settings);
            PipelineError::from(checks::doubting_unit(reason, facts).in_file(name))
        };
        let find = |pattern: &PlacedPattern| {
            let place = pattern.placing.place;
            let marked = fill::for_map(&pattern.placed, settings);
            let found = learned.recent.map(&marked, is_ink, place, method, || {
                LengthTrueMap::find_with_fork(&part.surface, &marked, is_ink, place, &method, &Cores)
            });
            found.map_err(|error| {
                rejected(pattern.map_reason(&error, &whole.kept, settings), &pattern.facts, &pattern.placed)
            })
        };
        let map = find(&pattern)?;
        let Some(turn) = map.round_angle().filter(|_| settings.placement.align == Align::Axis) else {
            return Ok((pattern, map));
        };
        let PlacedPattern { facts, mut placing, placed, .. } = pattern;
        placing.turn(turn);
        let placed = placed.transformed(&Affine::rigid(placing.place, turn, placing.place));
        checks::reach(&placed, is_ink, &whole.kept).map_err(|reason| rejected(reason, &facts, &placed))?;
        let ink = quality::sample(&placed, is_ink);
        let pattern = PlacedPattern { facts, placing, placed, ink };
        let map = find(&pattern)?;
        Ok((pattern, map))
    }

    pub(super) fn place(
        &self,
        input: PatternInput<'_>,
        part: &CachedSurface,
        settings: &JobSettings,
        steps: &Steps<'_>,
        clock: &mut Clock,
    ) -> Result<PlacedPattern, PipelineError> {
        steps.at(Step::Read);
        let rejected = |reason: Reason| PipelineError::from(reason.in_file(input.name));
        let content = Some(settings.content.values.clone());
        let options = PatternOptions { pace: self.pace, content, ..settings.pattern.options() };
        let PatternReading { mut pattern, facts } =
            pattern::read(input.bytes, &options).map_err(|error| match error {
                PatternReadError::TakesLong => PipelineError::TakesLong,
                error => error.reason_for(input.name).into(),
            })?;
        content::check_fields(&facts, input.name).map_err(rejected)?;
        let center = |pattern: &Pattern| FlatPoint::from(pattern.extents().center());
        let mut notices = Vec::new();
        let anchor = match settings.placement.anchor {
            // Other values have other widths. What is the same on all products must have the same place.
            Anchor::Center if !facts.fields.is_empty() => {
                let typical = Some(settings.content.values.typical());
                let typical = PatternOptions { content: typical, ..options };
                let anchor = pattern::read(input.bytes, &typical)
                    .map_or_else(|_| center(&pattern), |typical| center(&typical.pattern));
                let is_moved = Placing::new(anchor, settings).place != anchor;
                notices.extend(
                    Some(&pattern).filter(|_| is_moved).and_then(|pattern| off_center(pattern, anchor)),
                );
                anchor
            }
            Anchor::Center => center(&pattern),
            Anchor::Origin => FlatPoint::new(0.0, 0.0),
            Anchor::At(point) => point,
        };
        let codes = content::draw_codes(&mut pattern, &settings.content, &mut notices).map_err(rejected)?;
        clock.lap("read pattern");
        steps.at(Step::Place);
        let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
        let placing = Placing { codes, notices, ..Placing::new(anchor, settings) };
        let placed = pattern.transformed(&placing.motion);
        drop(pattern);
        let length = checks::reach(&placed, is_ink, part).map_err(|reason| {
            let reason = suggested_place::suggesting_place(reason, &placed, part, settings);
            rejected(checks::doubting_unit(reason, &facts))
        })?;
        checks::lost_ink(&facts, settings).map_err(rejected)?;
        checks::beside_part(&placed, is_ink, placing.place, part).map_err(|reason| {
            let reason = suggested_place::suggesting_place(reason, &placed, part, settings);
            rejected(checks::doubting_unit(reason, &facts))
        })?;
        self.check_pace((length / quality::PIECE) as usize * WORK_OF_PIECE, QUICK_WORK)?;
        let ink = quality::sample(&placed, is_ink);
        checks::anything_inked(&ink, &placed, settings).map_err(rejected)?;
        let work = ink.pieces.len() * WORK_OF_PIECE + ink.squares.len();
        self.check_pace(work, QUICK_WORK)?;
        clock.lap("place");
        Ok(PlacedPattern { facts, placing, placed, ink })
    }
}

impl LearnedPart {
    /// The part as a placed drawing needs it: with smaller spans where it has them, and without what the drawing is not marked on;
    /// `None` if that is the whole part.
    pub(super) fn needed_for(&self, drawing: &PlacedPattern, settings: &JobSettings) -> Option<Self> {
        let near = self.near(drawing, settings);
        let seen = near.as_ref().unwrap_or(self).on_marked_regions(drawing, self, settings);
        seen.or(near)
    }

    /// The part round a placed drawing, where its surface has smaller spans there.
    fn near(&self, drawing: &PlacedPattern, settings: &JobSettings) -> Option<Self> {
        if settings.rotary.tiles != Tiles::Off {
            return None;
        }
        self.kept.surface.round(&drawing.extents(settings)).map(|surface| self.with_surface(surface))
    }

    /// The same part with the surface that a drawing needs of it.
    pub(super) fn with_surface(&self, surface: FittedSurface) -> Self {
        let Self { kept, key, from_cache, settings, notices, timings, recent: _, mesh: _ } = self;
        let CachedSurface { origin, facts, surface: _, mark } = kept;
        let (origin, facts, mark) = (origin.clone(), facts.clone(), mark.clone());
        Self {
            kept: CachedSurface { origin, facts, surface, mark },
            key: key.clone(),
            from_cache: *from_cache,
            settings: settings.clone(),
            mesh: None,
            notices: notices.clone(),
            timings: timings.clone(),
            // What is remembered follows from the surface, and that from the drawing and the settings.
            recent: RecentDrawings::default(),
        }
    }
}

impl PlacedPattern {
    /// Why there is no map. What outlines enclose beside the part is no reason if nothing fills it.
    pub(super) fn map_reason(
        &self,
        error: &MapError,
        part: &CachedSurface,
        settings: &JobSettings,
    ) -> Reason {
        let marked = fill::marked_ink(&self.placed, &self.ink, settings);
        let ink = if is_on_part(&marked, &part.surface) { &marked } else { &self.ink };
        checks::map_reason(error, self.placing.place, part, ink)
    }
}

/// The share of a drawing's larger side by which its middle may be beside the place that is stated for it.
const OFF_CENTER: f64 = 0.1;

/// Warns of a drawing whose middle is not that of the texts that all products share.
fn off_center(pattern: &Pattern, anchor: FlatPoint) -> Option<Notice> {
    let extents = pattern.extents();
    let beside = extents.center() - anchor.coords();
    let side = (extents.max - extents.min).max();
    (beside.norm() > OFF_CENTER * side).then(|| {
        let message = format!(
            "the middle of what is marked is beside the stated place by x {:.2} and y {:.2} mm in the drawing's directions: texts with \
             fields have other lengths on other products, and all products are placed by the same point; align these texts in \
             the middle, or place the drawing by its origin (`anchor = \"origin\"` under [placement], `--anchor origin`)",
            beside.x, beside.y
        );
        Notice::warning("field-off-center", message)
    })
}

/// The placement of a drawing: its anchor, the anchor's place in the view, and the rigid motion between them.
#[derive(Clone)]
pub(super) struct Placing {
    pub(super) anchor: FlatPoint,
    pub(super) place: FlatPoint,
    pub(super) motion: Affine,
    /// The turn along the axis of a cylinder or cone, rad, in addition to that of the settings.
    aligned: f64,
    /// The codes of the drawing, before the motion.
    pub(super) codes: Vec<PlacedCode>,
    /// What is unusual about them.
    pub(super) notices: Vec<Notice>,
}

impl Placing {
    fn new(anchor: FlatPoint, settings: &JobSettings) -> Self {
        let place = settings.placement.place.map(|place| place.coords());
        let place = match &settings.part.view_source {
            ViewSource::Station | ViewSource::Sides | ViewSource::Rolled => {
                place.map_or(anchor, FlatPoint::from)
            }
            source @ (ViewSource::Frame(frame) | ViewSource::FrameOfFile(frame)) => {
                let is_used = settings.placement.is_place_given || matches!(source, ViewSource::Frame(_));
                (frame.place().coords() + place.filter(|_| is_used).unwrap_or_default()).into()
            }
        };
        Self {
            anchor,
            place,
            motion: Affine::rigid(anchor, settings.placement.rotate, place),
            aligned: 0.0,
            codes: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// The turn after which the drawing's x, before `rotate_deg`, is along the direction round the axis of the map, rad.
    pub(super) fn turn_to_axis(&self, map: &LengthTrueMap) -> f64 {
        map.round_angle().map_or(0.0, |round| round - self.aligned)
    }

    /// Turns the placed drawing about its anchor by this angle, rad.
    pub(super) fn turn(&mut self, angle: f64) {
        self.aligned += angle;
    }

    /// The motion with the turn along the axis.
    pub(super) fn whole_motion(&self) -> Affine {
        Affine::rigid(self.place, self.aligned, self.place).after(&self.motion)
    }

    /// The direction of the drawing's x in the placed drawing, rad.
    pub(super) fn direction(&self) -> f64 {
        let x = self.motion.linear.column(0);
        x[1].atan2(x[0]) + self.aligned
    }

    /// The direction of the drawing's x beside that round the axis of the map, if it has one.
    pub(super) fn round(&self, map: &LengthTrueMap, settings: &JobSettings) -> Option<RoundReport> {
        let round = map.round_angle()?;
        let whole = std::f64::consts::TAU;
        let from_round = settings.placement.rotate + self.aligned - round;
        let from_round = from_round - whole * (from_round / whole).round();
        Some(RoundReport { turned_deg: self.aligned.to_degrees(), angle_deg: from_round.to_degrees() })
    }

    pub(super) fn report(&self, settings: &JobSettings) -> PlacementReport {
        PlacementReport {
            facing: settings.part.facing.direction().into(),
            roll_deg: settings.part.roll.to_degrees(),
            anchor_mm: self.anchor.coords().into(),
            place_mm: self.place.coords().into(),
            rotate_deg: settings.placement.rotate.to_degrees(),
            round: None,
            frame: match settings.part.view_source {
                ViewSource::Station | ViewSource::Sides | ViewSource::Rolled => None,
                ViewSource::Frame(frame) => {
                    Some(FrameReport { source: FrameSource::Settings, frame: frame.into() })
                }
                ViewSource::FrameOfFile(frame) => {
                    Some(FrameReport { source: FrameSource::Part, frame: frame.into() })
                }
            },
        }
    }
}
