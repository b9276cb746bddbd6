//! A part in the unit and axes of its file, and the size limits of reading.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use super::clues::{Clues, Corners};
use super::error::{EmptyCause, VertexPlace};
use super::root_pose::RootPose;
use super::{
    FaceKind, FrameFacts, MeshNoise, MeshOptions, MeshReadError, NormalsChoice, NormalsFound, NormalsUsed,
    PartFacts, PartReading, Shape, SolidPart, UpAxis,
};
use crate::formats::Pace;
use crate::geometry::chord_normals;
use crate::geometry::cracks::{self, Cracks};
use crate::geometry::flat_shading::{OpenFacets, Rounding};
use crate::geometry::holes::{self, Bridge};
use crate::geometry::mesh::{MeshError, TriMesh};
use crate::geometry::noise;
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::shading::{self, Judgement};
use crate::geometry::solid::Solid;
use crate::geometry::solid::frame::Placement;
use crate::geometry::space::MarkingFrame;
use crate::geometry::winding::{self, Winding};
use crate::reason::Notice;

/// Largest number of triangles of a part; a million is already finer than any marking needs.
pub(super) const MAX_TRIANGLES: usize = 10_000_000;
/// Largest number of triangles at a quick pace, with the fit that follows.
pub(super) const QUICK_TRIANGLES: usize = 200_000;
/// Largest number of points of a scan; a million is already finer than any marking needs.
pub(super) const MAX_POINTS: usize = 10_000_000;

/// If a design has flat facets, its designer did not intend a smooth surface that leaves them by more than
/// this, mm. By default, CAD programs cut round faces into facets that leave them by at most 0.1 mm.
const NOTABLE_BULGE: f64 = 0.15;
/// The same where facets turn by more than [`NOTABLE_TURN`], mm: lengths along a smaller facet differ by 0.004 mm at most.
const NOTABLE_BULGE_OF_TURN: f64 = 0.02;
/// Along facets that turn by more than this, rad, lengths differ by more than 1 % from those on a round face.
/// By default, CAD programs let facets turn by at most 0.5 rad, so that round faces of small radius are below
/// it.
const NOTABLE_TURN: f64 = 0.51;

/// A part in the unit and axes of its file.
pub(super) struct RawPart {
    pub(super) positions: Vec<Point3<f64>>,
    /// One for each position, or empty.
    pub(super) normals: Vec<Vector3<f64>>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) normals_found: NormalsFound,
    pub(super) clues: Clues,
    /// Whether the positions are measured points; there are no triangles then.
    pub(super) is_scan: bool,
    /// The exact faces, mm, in the axes of the file; the triangles are a tessellation of them.
    pub(super) solid: Option<Solid>,
    /// Number of points that the scanner marked as missing.
    pub(super) missing: usize,
    /// Number of points at infinity, and the place of the first.
    pub(super) infinite: Option<(usize, VertexPlace)>,
    /// For each triangle, whether it is one of the faces named `mark`; empty if there are none.
    pub(super) is_mark: Vec<bool>,
    /// The nodes that are marking frames.
    pub(super) frames: Vec<FrameNode>,
    pub(super) bodies: Vec<String>,
    pub(super) materials: Vec<String>,
    pub(super) skipped: Vec<String>,
    pub(super) notices: Vec<Notice>,
}

impl RawPart {
    pub(super) fn new(clues: Clues) -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
            normals_found: NormalsFound::None,
            clues,
            is_scan: false,
            solid: None,
            missing: 0,
            infinite: None,
            is_mark: Vec::new(),
            frames: Vec::new(),
            bodies: Vec::new(),
            materials: Vec::new(),
            skipped: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// Makes it a scan of these points, with one normal for each or no normals.
    pub(super) fn set_scan(&mut self, points: Vec<Point3<f64>>, normals: Vec<Vector3<f64>>) {
        self.is_scan = true;
        self.normals_found = if normals.is_empty() { NormalsFound::None } else { NormalsFound::Smooth };
        (self.positions, self.normals) = (points, normals);
    }

    /// Decides the unit and the up axis, and converts the part to mm with +Z up.
    pub(super) fn into_reading(mut self, options: &MeshOptions) -> Result<PartReading, MeshReadError> {
        let corners = match self.is_scan {
            true => Corners::of_points(&self.positions),
            false => Corners::of(&self.positions, &self.triangles),
        };
        let verdict = self.clues.judge(&corners, options);
        let (scale, up) = (verdict.unit.value.in_mm(), verdict.up.value);
        if let Some(pose) = self.clues.misplaced(up) {
            self.relocate(&pose);
        }
        for position in &mut self.positions {
            *position = Point3::from(up.to_z_up(position.coords) * scale);
        }
        for normal in &mut self.normals {
            *normal = up.to_z_up(*normal);
        }
        let frame = self.frame(up, scale)?;
        let mark_faces = self.mark_faces();
        let misnamed = self.misnamed();
        let mut understood = Understood::default();
        let shape = match self.is_scan {
            true => {
                let all = self.positions.len();
                let first = self.positions.first().copied();
                let cloud = PointCloud::new(self.positions, self.normals);
                let far = all - cloud.points().len();
                if let Some(first) = first.filter(|_| far == all) {
                    return Err(MeshReadError::ScanTooFar { points: all, coordinate: first.coords.into() });
                }
                self.notices.extend(absent_notices(self.missing, self.infinite.as_ref(), far));
                self.missing += far + self.infinite.map_or(0, |(count, _)| count);
                Shape::Scan(cloud)
            }
            false => {
                let mesh =
                    TriMesh::new(self.positions, self.normals, self.triangles).map_err(
                        |error| match error {
                            MeshError::BadCoordinate { coordinate, .. } => {
                                MeshReadError::TooFar { coordinate }
                            }
                            _ => MeshReadError::NoTriangles { cause: EmptyCause::Flat },
                        },
                    )?;
                match self.solid.take() {
                    Some(solid) => {
                        understood.used = Some(NormalsUsed::File);
                        let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| up.to_z_up(axis));
                        let turn = Placement::turned(Matrix3::from_columns(&columns));
                        Shape::Solid(Box::new(SolidPart { solid: solid.placed(&turn), mesh }))
                    }
                    None => {
                        let (mesh, found) =
                            understood_mesh(mesh, &mut self.normals_found, &self.clues, options)?;
                        understood = found;
                        Shape::Mesh(mesh)
                    }
                }
            }
        };
        if understood.used == Some(NormalsUsed::Smoothed) && options.pace == Pace::Quick {
            return Err(MeshReadError::TakesLong);
        }
        let (size, triangles, vertices) = match &shape {
            Shape::Mesh(mesh) => (mesh.size(), mesh.triangles().len(), mesh.positions().len()),
            Shape::Solid(part) => {
                (part.mesh.size(), part.mesh.triangles().len(), part.mesh.positions().len())
            }
            Shape::Scan(cloud) => (cloud.size(), 0, cloud.points().len()),
        };
        let faces = match &shape {
            Shape::Solid(part) => face_kinds(&part.solid),
            Shape::Mesh(_) | Shape::Scan(_) => Vec::new(),
        };
        if vertices == 0 {
            return Err(MeshReadError::NoPoints { missing: self.missing });
        }
        self.notices.extend(verdict.notices);
        self.notices.extend(misnamed);
        self.notices.extend(understood.notices(triangles));
        let is_estimated = matches!(understood.used, Some(NormalsUsed::Estimated | NormalsUsed::Mixed));
        let spoilt = understood.winding.spoilt_normals;
        self.notices.extend(self.normals_found.notice(&understood.judged, spoilt).filter(|_| is_estimated));
        if self.normals_found == NormalsFound::None && spoilt > 0 {
            self.normals_found = NormalsFound::Averaged;
        }
        let facts = PartFacts {
            format: Some(self.clues.format),
            producer: self.clues.producer,
            unit: verdict.unit,
            up: verdict.up,
            size: size.into(),
            triangles,
            vertices,
            normals: self.normals_found,
            normals_used: understood.used,
            normals_missing: understood.missing,
            noise: understood.noise,
            scatter: understood.scatter,
            normals_lean_deg: understood.normals_lean.map(f64::to_degrees),
            frame: frame.map(FrameFacts::from),
            sides: Vec::new(),
            mark_area_mm2: (!mark_faces.is_empty()).then(|| mark_faces.iter().map(area).sum()),
            one_sided_at_mm: understood.winding.contradiction.map(|at| at.coords.into()),
            faces,
            round_faces: Vec::new(),
            bodies: self.bodies,
            materials: self.materials,
            skipped: self.skipped,
            scan: None,
            notices: self.notices,
        };
        Ok(PartReading { shape, mark_faces, facts })
    }
}

/// Whether a point is at infinity. A coordinate that is not a number marks a point without a measurement instead.
pub(super) fn is_infinite(point: &Point3<f64>) -> bool {
    point.iter().any(|value| value.is_infinite()) && !point.iter().any(|value| value.is_nan())
}

/// The points of a scan that were skipped: those marked as missing, those at infinity with the place of the first, and
/// those too far away.
fn absent_notices(
    missing: usize,
    infinite: Option<&(usize, VertexPlace)>,
    far: usize,
) -> impl Iterator<Item = Notice> {
    let missing = (missing > 0).then(|| {
        let text = format!("{missing} points are marked as missing and were skipped");
        Notice::note("scan-points-missing", text)
    });
    let infinite = infinite.map(|(count, first)| {
        let text = format!(
            "{count} points are at infinity and were skipped, the first: {first}; check the export if the scanner saw \
             something there"
        );
        Notice::warning("scan-points-far", text)
    });
    let far = (far > 0).then(|| {
        let text = format!(
            "{far} points are more than {} mm from the origin and were skipped; check the part's unit (`--part-unit`)",
            TriMesh::LARGEST_COORDINATE
        );
        Notice::warning("scan-points-far", text)
    });
    missing.into_iter().chain(infinite).chain(far)
}

fn face_kinds(solid: &Solid) -> Vec<FaceKind> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    solid.faces.iter().for_each(|face| *counts.entry(&face.kind).or_default() += 1);
    counts.into_iter().map(|(kind, count)| FaceKind { kind: kind.to_owned(), count }).collect()
}

/// The area of a triangle, mm².
fn area([a, b, c]: &[Point3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// A node of the file that is a marking frame.
pub(super) struct FrameNode {
    /// Whether its name is written exactly as documented.
    pub(super) is_exact: bool,
    /// Its transform, in the unit and axes of the file.
    pub(super) transform: Matrix4<f64>,
}

/// The name of faces that bound where ink may be.
const MARK: &str = "mark";
/// Largest number of misspelt names that are reported.
const MAX_MISNAMED: usize = 3;

/// Whether a body, group or material of this name bounds where ink may be. Other spellings are names of their own, such as
/// `MARK` for a material; a notice reports them.
pub(super) fn bounds_ink(name: &str) -> bool {
    name.trim() == MARK
}

/// The notice about objects that the file hides, and which are left out.
pub(super) fn hidden_notice(count: usize) -> Option<Notice> {
    (count > 0).then(|| {
        let objects = match count {
            1 => "1 object that the file hides is".to_owned(),
            _ => format!("{count} objects that the file hides are"),
        };
        let message =
            format!("{objects} left out; show in your program what the laser meets, and export again");
        Notice::warning("part-hidden", message)
    })
}

/// Whether the names differ at most in case, in spaces around them, and in the number that Blender adds to the name of a
/// copy (`.001`).
pub(super) fn is_nearly(name: &str, documented: &str) -> bool {
    let name = name.trim();
    let is_number = |text: &str| text.len() >= 3 && text.bytes().all(|byte| byte.is_ascii_digit());
    let name = name.rsplit_once('.').filter(|(_, number)| is_number(number)).map_or(name, |(name, _)| name);
    name.eq_ignore_ascii_case(documented)
}

impl RawPart {
    /// Puts the part to where it is in CAD.
    fn relocate(&mut self, pose: &RootPose) {
        for position in &mut self.positions {
            *position = pose.relocated(position.coords).into();
        }
        for normal in &mut self.normals {
            *normal = pose.relocated_direction(*normal);
        }
        for FrameNode { transform, .. } in &mut self.frames {
            for column in 0..3 {
                let axis = transform.fixed_view::<3, 1>(0, column).into_owned();
                transform.fixed_view_mut::<3, 1>(0, column).copy_from(&pose.relocated_direction(axis));
            }
            let origin = transform.fixed_view::<3, 1>(0, 3).into_owned();
            transform.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.relocated(origin));
        }
    }

    /// The corners of the faces named `mark`.
    fn mark_faces(&self) -> Vec<[Point3<f64>; 3]> {
        let named = self.triangles.iter().zip(&self.is_mark).filter(|(_, is_mark)| **is_mark);
        let corner = |index: u32| self.positions.get(index as usize).copied();
        named
            .filter_map(|(&[a, b, c], _)| Some([corner(a)?, corner(b)?, corner(c)?]))
            .filter(|face| area(face) > 0.0)
            .collect()
    }

    /// Warns of names that differ little from that of faces that bound the ink.
    fn misnamed(&self) -> Option<Notice> {
        let names = self
            .bodies
            .iter()
            .chain(&self.materials)
            .filter(|name| is_nearly(name, MARK) && !bounds_ink(name));
        let names: BTreeSet<String> = names.map(|name| format!("\"{}\"", name.escape_debug())).collect();
        let names = names.into_iter().take(MAX_MISNAMED).collect::<Vec<_>>().join(", ");
        (!names.is_empty()).then(|| {
            let message = format!(
                "faces named {names} do not bound where ink may be: only the name `{MARK}` does, in small letters and without a \
                 number"
            );
            Notice::warning("mark-misnamed", message)
        })
    }

    /// The first marking frame of the file, in the part frame, mm, for a file with this axis up and this many mm a unit.
    fn frame(&mut self, up: UpAxis, scale: f64) -> Result<Option<MarkingFrame>, MeshReadError> {
        let is_exact = self.frames.iter().any(|node| node.is_exact);
        self.frames.retain(|node| node.is_exact == is_exact);
        let Some(FrameNode { transform: first, .. }) = self.frames.first() else { return Ok(None) };
        // The axes of a node are turned like the part: those of a node without rotation become those of the part frame.
        let turn =
            Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| up.to_z_up(axis)));
        let axes = turn * first.fixed_view::<3, 3>(0, 0) * turn.transpose();
        let origin = Point3::from(up.to_z_up(first.fixed_view::<3, 1>(0, 3).into_owned()) * scale);
        let frame = MarkingFrame::new(origin, axes.column(2).into_owned(), axes.column(0).into_owned());
        let frame = frame.ok_or(MeshReadError::FrameWithoutAxes)?;
        if axes.determinant() < 0.0 {
            return Err(MeshReadError::FrameMirrored);
        }
        if self.frames.len() > 1 {
            let message = format!(
                "{} nodes of the file are named `isomark`; the first one, at ({:.2}, {:.2}, {:.2}) mm of the part, is the \
                 marking frame",
                self.frames.len(),
                origin.x,
                origin.y,
                origin.z
            );
            self.notices.push(Notice::warning("frame-ambiguous", message));
        }
        Ok(Some(frame))
    }
}

/// What was found of a mesh, and what its surface follows.
#[derive(Default)]
struct Understood {
    cracks: Option<Cracks>,
    winding: Winding,
    bridges: Vec<Bridge>,
    noise: Option<MeshNoise>,
    /// Scatter that can be seen and does not mislead the normals.
    scatter: Option<MeshNoise>,
    /// How far the file's normals, which are used, lean from a smooth surface, rad, where they do not fit one.
    normals_lean: Option<f64>,
    judged: Judgement,
    used: Option<NormalsUsed>,
    /// Vertices without a normal, where others have one.
    missing: usize,
    /// Whether the settings ask for normals that the file does not have.
    lacks_normals: bool,
    /// How a smooth surface leaves facets that may be meant as they are, where it matters most.
    rounded: Option<Rounding>,
    /// The setting that marks such facets as they are.
    keeps_facets: &'static str,
    /// Whether the file's normals make facets flat that may be those of a round face.
    has_flat_facets: bool,
}

/// The mesh whose triangles run alike, with small holes bridged and normals that mean what the options ask for.
fn understood_mesh(
    mesh: TriMesh,
    found: &mut NormalsFound,
    clues: &Clues,
    options: &MeshOptions,
) -> Result<(TriMesh, Understood), MeshReadError> {
    let (mesh, cracks) = cracks::joined(mesh);
    let (mesh, winding) = winding::made_alike(mesh);
    if mesh.normals().is_empty() && winding.spoilt_normals > 0 {
        *found = NormalsFound::None;
    }
    let (mesh, bridges) = holes::bridged(mesh, options.bridge);
    let found_noise = noise::of(&mesh);
    let noise = found_noise.filter(|noise| noise.misleads).map(|noise| MeshNoise::new(&noise));
    let scatter = found_noise.filter(|noise| !noise.misleads).map(|noise| MeshNoise::new(&noise));
    // The facets of large meshes are small. If the file shades some of them flat, they are looked at all the same.
    let is_looked_at = options.normals == NormalsChoice::Auto
        && !(mesh.normals().is_empty() && mesh.triangles().len() > QUICK_TRIANGLES);
    let open = if is_looked_at { OpenFacets::of(&mesh) } else { None };
    let open = open.filter(|open| !(open.has_smooth && clues.knows_faces()));
    let chosen = open.as_ref().map_or(&[][..], |open| &open.is_of_flat_body);
    let has_flat_bodies = !chosen.is_empty();
    let mesh = if !has_flat_bodies {
        mesh
    } else if chosen.iter().all(|is_flat| *is_flat) {
        *found = NormalsFound::FacetsOnly;
        mesh.without_normals()
    } else {
        mesh.without_normals_at(chosen)
    };
    let judged = shading::judged(&mesh, clues.knows_faces());
    if judged.only_shades {
        *found = NormalsFound::Averaged;
    }
    let is_missing = |normal: &&Vector3<f64>| **normal == Vector3::zeros();
    let missing = mesh.normals().iter().filter(is_missing).count();
    let of_file = match missing {
        0 => NormalsUsed::File,
        _ => NormalsUsed::Mixed,
    };
    let used = match (options.normals, *found) {
        (NormalsChoice::Facets, _) | (NormalsChoice::File, NormalsFound::FacetsOnly) => NormalsUsed::Facets,
        // Normals that a CAD program wrote stay right where rounded coordinates scatter.
        (NormalsChoice::Auto, NormalsFound::None | NormalsFound::FacetsOnly | NormalsFound::Averaged)
            if noise.is_some() =>
        {
            NormalsUsed::Smoothed
        }
        (NormalsChoice::Estimate, _) | (_, NormalsFound::None | NormalsFound::FacetsOnly) => {
            NormalsUsed::Estimated
        }
        (NormalsChoice::Auto, NormalsFound::Averaged) => NormalsUsed::Estimated,
        (NormalsChoice::Auto, NormalsFound::Smooth) => of_file,
        (NormalsChoice::File, NormalsFound::Averaged | NormalsFound::Smooth) => of_file,
    };
    let is_rounded = used == NormalsUsed::Estimated && *found != NormalsFound::Averaged || has_flat_bodies;
    let (roundings, turns) = open.map(|open| (open.roundings, open.turns)).unwrap_or_default();
    let understood = Understood {
        rounded: roundings
            .into_iter()
            .filter(|rounding| is_rounded && is_notable(rounding))
            .max_by(|one, other| one.bulge.total_cmp(&other.bulge)),
        // Only a file with smooth bodies, too, has normals that keep them smooth.
        keeps_facets: if *found == NormalsFound::Smooth { "file" } else { "facets" },
        has_flat_facets: !turns.is_empty(),
        cracks,
        winding,
        bridges,
        noise,
        scatter,
        normals_lean: matches!(used, NormalsUsed::File | NormalsUsed::Mixed)
            .then(|| chord_normals::turned(&mesh))
            .flatten(),
        judged,
        used: Some(used),
        missing: if used == NormalsUsed::Mixed { missing } else { 0 },
        lacks_normals: options.normals == NormalsChoice::File && *found == NormalsFound::None,
    };
    let mesh = match (used, *found, options.normals) {
        (NormalsUsed::Facets, ..) => mesh.with_flat_facets(),
        (NormalsUsed::Estimated, _, NormalsChoice::Estimate) => mesh.without_normals(),
        (NormalsUsed::Estimated | NormalsUsed::Smoothed, NormalsFound::Averaged, _) => {
            mesh.with_shading_normals()
        }
        (NormalsUsed::File | NormalsUsed::Mixed, NormalsFound::Smooth, _) if clues.knows_faces() => {
            mesh.with_exact_normals()
        }
        _ => mesh,
    };
    Ok((mesh.with_open_turns(turns), understood))
}

/// Whether it matters if a facet is meant to be flat or round.
fn is_notable(Rounding { turn, bulge }: &Rounding) -> bool {
    *bulge > NOTABLE_BULGE || *turn > NOTABLE_TURN && *bulge > NOTABLE_BULGE_OF_TURN
}

impl Understood {
    /// The notices for people about the part, which has `triangles` triangles.
    fn notices(&self, triangles: usize) -> impl Iterator<Item = Notice> {
        let lacking = self.lacks_normals.then(|| {
            let why = match self.winding.spoilt_normals {
                0 => "it has none",
                _ => "they are averages of triangles that run in opposite ways",
            };
            let message = format!(
                "the settings ask for the file's normals, and {why}: they are estimated from the mesh"
            );
            Notice::warning("normals-missing", message)
        });
        let rounded = self.rounded.map(|rounding| {
            let message = format!(
                "nothing in the file tells whether the part is round or its facets are flat: they are taken for those of a \
                 smooth surface, which is up to {:.2} mm above them and {:.1} % longer. If they are meant as they are, set \
                 `normals = \"{choice}\"` (`--normals {choice}`); if the part is round, export it with smooth shading or with a \
                 smaller deviation",
                rounding.bulge,
                100.0 * rounding.lengthening(),
                choice = self.keeps_facets
            );
            Notice::warning("facets-rounded", message)
        });
        let flat = self.has_flat_facets.then(|| {
            let message = "facets that look like those of a round face are shaded flat, and others beside them smooth: they are \
                           marked as flat, and the reported errors allow for both shapes. If they are flat, set \
                           `normals = \"file\"` (`--normals file`); if they are round, shade them smooth, too";
            Notice::warning("facets-flat", message)
        });
        let noisy = self.noise.zip(self.used).map(|(noise, used)| noise.notice(used));
        let cracks = self.cracks.as_ref().map(crack_notice).into_iter();
        cracks
            .chain(winding_notices(&self.winding, triangles))
            .chain(bridge_notice(&self.bridges))
            .chain(lacking)
            .chain(noisy)
            .chain(rounded)
            .chain(flat)
    }
}

fn crack_notice(Cracks { sides, width, at }: &Cracks) -> Notice {
    let message = format!(
        "triangles of the mesh do not quite meet: sides that are up to {width:.4} mm apart were joined ({sides} pairs in all), the \
         farthest apart near ({:.2}, {:.2}, {:.2}) mm of the part",
        at.x, at.y, at.z
    );
    Notice::note("cracks-joined", message).at_places([(*at).into()])
}

fn bridge_notice(bridges: &[Bridge]) -> Option<Notice> {
    let Bridge { at, width, sides } = bridges.first()?;
    let holes = match bridges.len() {
        1 => "a hole in the mesh was bridged, where triangles are missing:".to_owned(),
        count => format!("{count} holes in the mesh were bridged, where triangles are missing; the widest:"),
    };
    let message = format!(
        "{holes} {width:.2} mm wide with {sides} sides, at ({:.2}, {:.2}, {:.2}) mm of the part; `bridge_mm = 0` leaves holes \
         open",
        at.x, at.y, at.z
    );
    Some(Notice::warning("hole-bridged", message).at_places(bridges.iter().map(|bridge| bridge.at.into())))
}

fn winding_notices(winding: &Winding, triangles: usize) -> impl Iterator<Item = Notice> {
    let reversed = (winding.reversed > 0).then(|| {
        let normals = match winding.spoilt_normals {
            0 => "the file has no normals that show the outside".to_owned(),
            spoilt => format!(
                "the file's normals were computed from them, so {spoilt} of these are wrong and are estimated"
            ),
        };
        let message = format!(
            "{} of {triangles} triangles were reversed because their corners ran the opposite way to those of \
             their neighbours; {normals}",
            winding.reversed
        );
        Notice::note("winding-made-alike", message)
    });
    let contradiction = winding.contradiction.map(|at| {
        let message = format!(
            "the part has only one side, like a Möbius strip: its triangles cannot all have the same orientation, so \
             the surface is unknown near ({:.2}, {:.2}, {:.2}) mm of the part; repair the mesh",
            at.x, at.y, at.z
        );
        Notice::warning("winding-contradicts", message).at_places([at.into()])
    });
    reversed.into_iter().chain(contradiction)
}

/// Refuses more work than the pace allows; a quick pace allows at most `quick_limit`.
pub(super) fn check_pace(pace: Pace, work: usize, quick_limit: usize) -> Result<(), MeshReadError> {
    if pace.allows(work, quick_limit) { Ok(()) } else { Err(MeshReadError::TakesLong) }
}

/// Refuses a number of something above its limit.
pub(super) fn at_most(what: &'static str, count: usize, limit: usize) -> Result<(), MeshReadError> {
    if count > limit {
        return Err(MeshReadError::TooLarge { what, count: count as u64, limit: limit as u64 });
    }
    Ok(())
}
