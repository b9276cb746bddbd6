//! `isomark register`: where the part stands under the laser, and the outline to put it into.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::{Point3, Vector2};
use serde::Serialize;

use super::calibrate::{Measured, parse_reading};
use super::named_files::{apart, name_of, read_file, read_part, share_is_there, write_file};
use super::options::parse_sku;
use super::outcome::{Failure, Outcome, print, print_json, shown};
use super::set::SetArguments;
use super::station_edit::{self, Change};
use crate::config::{JobSettings, LiveSettings, NewValue, Station};
use crate::formats::Pace;
use crate::formats::measurements::{Measurements, MeasurementsError};
use crate::formats::mesh::{self, MeshFormat};
use crate::formats::pattern;
use crate::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::mesh::TriMesh;
use crate::geometry::optics::registration::{
    AssumedHeight, Contact, Contacts, EdgeContact, Height, Registration, RegistrationError,
};
use crate::geometry::pattern::{Color, Layer};
use crate::geometry::silhouette::silhouette;
use crate::geometry::space::{Extents, FieldPoint, ViewPoint};
use crate::hotfolder::UsedFolder;
use crate::pipeline::learning::unknown_part_format;
use crate::pipeline::{profile, program};
use crate::printable::on_one_line;
use crate::reason::{Notice, Reason};

/// Name and version of the JSON form of a [`RegistrationDocument`].
const SCHEMA: &str = "isomark.registration/1";
/// Straight sides of an outline are divided into pieces of this length, mm, because a measured lens may bend them.
const PIECE: f64 = 2.0;
/// Coordinates beyond this are mistakes, mm.
const FARTHEST: f64 = 10_000.0;

#[derive(Debug, Args)]
pub(super) struct RegisterArguments {
    /// The station's settings.
    station: PathBuf,
    /// The product whose settings are used and written; default: the station's settings for every part.
    #[arg(long)]
    sku: Option<String>,
    /// The part (.step, .glb, .gltf, .obj, .stl, .ply, .3mf): gives the height of points that are named by x and y of the view, and the outline for `--jig`.
    #[arg(long, value_name = "FILE")]
    part: Option<PathBuf>,
    /// A point of the part and where the pilot beam or a mark hits it in the field: "X,Y,Z=X,Y" in the part's own axes (+Z up, mm), or with `--part` "X,Y=X,Y" in the laser's view; three or more.
    #[arg(long, value_name = "POINT=FIELD", allow_hyphen_values = true)]
    pair: Vec<String>,
    /// A table of such pairs, with the columns x_mm, y_mm, z_mm, field_x_mm, field_y_mm.
    #[arg(long, value_name = "FILE.csv")]
    pairs: Option<PathBuf>,
    /// An edge of the part, by two of its points, and points of the field that hit it anywhere: "X,Y,Z X,Y,Z=X,Y X,Y"; two edges or more.
    #[arg(long, value_name = "EDGE=FIELD", allow_hyphen_values = true)]
    edge: Vec<String>,
    /// Height of the part's origin above the calibrated plane, mm, if it is known. Default: found through a lens that is not telecentric; without it, or where the points do not show it, that of the settings.
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = parse_coordinate)]
    z: Option<f64>,
    /// Standard deviation of one observation in the field, mm. Used while the observations are too few to show it.
    #[arg(long, value_name = "MM", default_value_t = 0.1, allow_hyphen_values = true, value_parser = parse_reading)]
    reading: f64,
    /// Writes the part's outline as a drawing, seen through the lens: marked on a plate, the part can be put into it. With pairs, for the pose that is found; otherwise for that of the settings.
    #[arg(long, value_name = "FILE.dxf", requires = "part")]
    jig: Option<PathBuf>,
    /// Height of the plate for `--jig` above the calibrated plane, mm. Default: the part stands on it.
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = parse_coordinate)]
    plate: Option<f64>,
    /// Enters the result into the settings of the station, or with `--sku` of the SKU; comments are kept.
    #[arg(long)]
    write: bool,
    /// Prints the result as JSON.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    set: SetArguments,
}

fn parse_coordinate(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.abs() <= FARTHEST);
    number.ok_or_else(|| "give a number in mm, as in 12.5".into())
}

/// The result of `register`.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct RegistrationDocument {
    schema: &'static str,
    /// Name and version of the program.
    program: String,
    /// The station's name.
    station: String,
    /// Offset of the part's origin to the right, mm.
    x_mm: Measured,
    /// Offset upwards, mm.
    y_mm: Measured,
    /// Height of the part's origin above the calibrated plane, mm.
    z_mm: MaybeMeasured,
    /// Rotation about the laser's axis, deg counter-clockwise.
    rotation_deg: Measured,
    /// Standard deviation of one observation, mm.
    reading_mm: f64,
    /// Number of values beyond those that are needed.
    spare: usize,
    /// For each pair, seen minus fitted in the field, mm.
    residuals_mm: Vec<[f64; 2]>,
    /// For each point on an edge, its distance from the fitted edge in the field, mm.
    edge_residuals_mm: Vec<f64>,
    /// The settings, as lines of a settings file.
    settings: Vec<String>,
    /// What was noticed.
    notices: Vec<Notice>,
}

/// A height that may be given, found or assumed.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MaybeMeasured {
    /// The height.
    value: f64,
    /// Its standard deviation; absent if it was given, or has no effect because the lens is telecentric.
    #[serde(skip_serializing_if = "Option::is_none")]
    deviation: Option<f64>,
}

pub(super) fn run(arguments: &RegisterArguments) -> Outcome {
    let mut live = LiveSettings::open_with(&arguments.station, arguments.set.of_station()?)?.at_once();
    let sku = arguments.sku.as_deref().map(parse_sku).transpose()?;
    if sku.is_some() {
        share_is_there(live.station(), UsedFolder::Skus)?;
    }
    let mut settings = match &sku {
        // A station that was never started has no folder for its SKUs yet.
        Some(sku) if live.station().folders.skus.exists() => live.job(sku)?,
        _ => live.station().settings.clone(),
    };
    let station = live.station();
    let target = match &sku {
        Some(sku) => station.folders.skus.join(format!("{sku}.toml")),
        None => arguments.station.clone(),
    };
    let read: Vec<&Path> = [Some(&arguments.station), arguments.part.as_ref(), arguments.pairs.as_ref()]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    let written: Vec<(&str, &Path)> =
        arguments.jig.as_deref().map(|file| ("--jig", file)).into_iter().collect();
    apart(&read, &written)?;
    let part = arguments.part.as_deref().map(|file| read_mesh(file, &mut settings)).transpose()?;
    let contacts = contacts(arguments, &settings, part.as_ref())?;
    let is_asked = !contacts.points.is_empty() || !contacts.edges.is_empty();
    if !is_asked && arguments.jig.is_none() {
        return Err(Failure::usage(
            "No pairs are given.",
            "Give three points of the part with the points of the field that hit them, as in `--pair 0,0,10=52.1,40.3`, or `--jig FILE.dxf`.",
        ));
    }
    if !is_asked && (arguments.write || arguments.json) {
        return Err(Failure::usage(
            "`--write` and `--json` need pairs or edges.",
            "Give them with `--pair`, `--pairs` or `--edge`.",
        ));
    }
    let head = settings.scan_head();
    let mut text = String::new();
    if is_asked {
        let height = arguments.z.map_or(Height::Unknown(settings.fixture.z), Height::Known);
        let found = Registration::fit(&contacts, &head, height)
            .map_err(|error| Failure::rejected(reason(&error, &contacts)))?;
        settings.fixture = found.fixture;
        let changes = changes(&found);
        let document = document(station, &contacts, &found, &changes);
        if let Some(height) = found.assumed_height.filter(|_| arguments.write) {
            return Err(Failure::rejected(height_not_shown(&found, height)));
        }
        if arguments.write {
            station_edit::write(&target, "fixture", &changes, |text| match &sku {
                Some(_) => station.settings.overridden_by(&target, text).map(|_| ()),
                None => Station::parse(&target, text).map(|_| ()),
            })?;
        }
        if arguments.json {
            let json = serde_json::to_string_pretty(&document)
                .map_err(|error| Failure::environment(&error.into()))?;
            print_json(&(json + "\n"));
        }
        let height = match (arguments.z, found.assumed_height) {
            (Some(_), _) => "as given",
            (None, Some(_)) => "assumed",
            (None, None) => "as in the settings",
        };
        text = self::text(&document, height, arguments.write.then_some(target.as_path()));
    }
    if let (Some(file), Some(part)) = (&arguments.jig, &part) {
        let (drawing, plate) = jig(part, &settings, arguments.plate)?;
        write_file(file, &pattern::write(&drawing, profile(&settings)))?;
        let _ = writeln!(
            text,
            "\nwritten  {}: the outline of the part, for a plate whose top is {plate:.2} mm above the calibrated plane",
            shown(file)
        );
    }
    if !arguments.json {
        print(text.trim_start_matches('\n'));
    }
    Ok(())
}

/// The triangles of a part; a marking frame in its file gives the view unless the settings do.
fn read_mesh(file: &Path, settings: &mut JobSettings) -> Result<TriMesh, Failure> {
    let name = name_of(file)?;
    let format = MeshFormat::from_name(&name).ok_or_else(|| Failure::rejected(unknown_part_format(&name)))?;
    let part = read_part(file)?;
    let options = settings.part.mesh_options(Pace::default());
    let reading = mesh::read(&part.bytes, format, &options, &part.siblings)
        .map_err(|error| Failure::rejected(error.reason().in_file(&name)))?;
    settings.part = settings.part.for_part_with(reading.facts.marking_frame());
    let mesh = reading.shape.mesh().cloned();
    mesh.ok_or_else(|| {
        Failure::usage(format!("\"{name}\" is a scan, and `--part` needs a mesh."), "Name a mesh.")
    })
}

/// What was typed, with all points in the view.
fn contacts(
    arguments: &RegisterArguments,
    settings: &JobSettings,
    part: Option<&TriMesh>,
) -> Result<Contacts, Failure> {
    let view = settings.part.view();
    let in_view = |point: &[f64], typed: &str| match (point, part) {
        ([x, y, z], _) => Ok(view.point(Point3::new(*x, *y, *z))),
        ([x, y], Some(mesh)) => {
            let at = Vector2::new(*x, *y);
            let corners = mesh
                .triangles()
                .iter()
                .map(|triangle| mesh.corners(*triangle).map(|corner| view.point(corner)));
            let highest =
                corners.filter_map(|corners| height_in(&corners, at)).fold(f64::NEG_INFINITY, f64::max);
            match highest.is_finite() {
                true => Ok(at.push(highest).into()),
                false => Err(Failure::rejected(
                    Reason::new(
                        "pose-not-determined",
                        format!("The point ({x}, {y}) mm of the view is beside the part."),
                        "Give a point on the part, or all three coordinates.",
                    )
                    .with_number(
                        "distance from the middle of the view",
                        at.norm(),
                        "mm",
                        None,
                    ),
                )),
            }
        }
        _ => Err(Failure::usage(
            format!("`{typed}` does not name a point of the part."),
            "Give X,Y,Z in the part's own axes; with `--part`, X,Y in the laser's view is enough.",
        )),
    };
    let field = |point: &[f64], typed: &str| match point {
        [x, y] => Ok(FieldPoint::new(*x, *y)),
        _ => Err(Failure::usage(
            format!("`{typed}` does not name a point of the field."),
            "Give its X,Y in mm behind the equals sign.",
        )),
    };
    let mut contacts = Contacts { reading: arguments.reading, ..Contacts::default() };
    for typed in &arguments.pair {
        let [points, hits] = sides(typed)?;
        let ([point], [hit]) = (&points[..], &hits[..]) else {
            return Err(Failure::usage(
                format!("`--pair {typed}` does not have one point on each side."),
                "Give POINT=FIELD, as in `--pair 0,0,10=52.1,40.3`.",
            ));
        };
        contacts.points.push(Contact { view: in_view(point, typed)?, hit: field(hit, typed)? });
    }
    for typed in &arguments.edge {
        let [points, hits] = sides(typed)?;
        let ([from, to], [_, ..]) = (&points[..], &hits[..]) else {
            return Err(Failure::usage(
                format!(
                    "`--edge {typed}` does not have two points of the part and one or more of the field."
                ),
                "Give EDGE=FIELD, as in `--edge \"0,0,10 50,0,10=52.1,40.3 80.4,41.0\"`.",
            ));
        };
        let ends = [in_view(from, typed)?, in_view(to, typed)?];
        if (ends[1] - ends[0]).xy().norm() < 1.0 {
            return Err(Failure::usage(
                format!("The two points of `--edge {typed}` are less than 1 mm apart in the laser's view."),
                "Give two points near the ends of the edge.",
            ));
        }
        for hit in &hits {
            contacts.edges.push(EdgeContact { ends, hit: field(hit, typed)? });
        }
    }
    if let Some(file) = &arguments.pairs {
        let unreadable = |error: MeasurementsError| {
            let mut reason = error.reason();
            // A person writes this table.
            if let MeasurementsError::NoColumn { found, .. } = &error {
                reason.remedy = format!(
                    "Name the columns x_mm, y_mm, z_mm, field_x_mm and field_y_mm: the point of the part and the point of the field that \
                     hits it. The table has {}.",
                    found.join(", ")
                );
            }
            Failure::rejected(reason.in_file(file.display().to_string()))
        };
        let table = Measurements::read(&read_file(file)?).map_err(unreadable)?;
        for row in 0..table.len() {
            let number = |name: &str| table.required(row, name).map_err(unreadable);
            let z = if table.has("z_mm") { table.number(row, "z_mm").map_err(unreadable)? } else { None };
            let point: Vec<f64> = [number("x_mm")?, number("y_mm")?].into_iter().chain(z).collect();
            let line = format!("line {} of {}", table.line(row), file.display());
            let hit = FieldPoint::new(number("field_x_mm")?, number("field_y_mm")?);
            contacts.points.push(Contact { view: in_view(&point, &line)?, hit });
        }
    }
    Ok(contacts)
}

/// The points before and behind the equals sign.
fn sides(typed: &str) -> Result<[Vec<Vec<f64>>; 2], Failure> {
    let wrong = || {
        Failure::usage(
            format!("`{typed}` cannot be read as points."),
            "Give coordinates in mm with commas between them, and an equals sign before the field, as in 0,0,10=52.1,40.3.",
        )
    };
    let (part, field) = typed.split_once('=').ok_or_else(wrong)?;
    let points = |text: &str| -> Option<Vec<Vec<f64>>> {
        let point = |word: &str| word.split(',').map(|number| parse_coordinate(number).ok()).collect();
        text.split_whitespace().map(point).collect()
    };
    match (points(part), points(field)) {
        (Some(part), Some(field)) => Ok([part, field]),
        _ => Err(wrong()),
    }
}

/// The height of a triangle at a place of the view; `None` beside it.
fn height_in(corners: &[Point3<f64>; 3], at: Vector2<f64>) -> Option<f64> {
    let [a, b, c] = corners.map(|corner| corner.coords.xy());
    let whole = (b - a).perp(&(c - a));
    if whole == 0.0 {
        return None;
    }
    let shares = [(b - at).perp(&(c - at)), (c - at).perp(&(a - at)), (a - at).perp(&(b - at))]
        .map(|share| share / whole);
    let height = || shares.iter().zip(corners).map(|(share, corner)| share * corner.z).sum();
    shares.iter().all(|share| *share >= -1e-9).then(height)
}

fn reason(error: &RegistrationError, contacts: &Contacts) -> Reason {
    let pose = |remedy: &str| Reason::new("pose-not-determined", format!("{error}."), remedy);
    let pair = |index: usize| {
        let Contact { view, hit } = contacts.points[index];
        format!(
            "pair {} (view {:.2}, {:.2}, {:.2} = field {:.2}, {:.2})",
            index + 1,
            view.x,
            view.y,
            view.z,
            hit.x,
            hit.y
        )
    };
    match *error {
        RegistrationError::TooFew { count } => {
            pose("Give at least three points that form a triangle, or points on two edges.")
                .with_number("points", count as f64, "", Some(3.0))
        }
        RegistrationError::TooMany { count } => {
            pose("Give fewer points, far apart.").with_number("points", count as f64, "", Some(200.0))
        }
        RegistrationError::OnLine { width, needed } => {
            pose("Add a point beside the line, so that the points form a triangle.")
                .with_number("largest distance from the line", width, "mm", Some(needed))
        }
        RegistrationError::Parallel { degrees } => {
            pose("Use two edges that meet at an angle, best 90 deg, or add a point.")
                .with_number("angle", degrees, "deg", Some(10.0))
        }
        RegistrationError::Mirrored => Reason::new(
            "measurements-swapped",
            format!("{error}."),
            "Give x before y, x to the right and y upwards, in the part's file and in the field; check that no two points are \
             interchanged, and check `facing` of the part.",
        ),
        RegistrationError::AboveLens { height, lens } => {
            pose("Check `--z` or `z_mm` under [fixture], the lens distances under [optics], and the unit of the points.")
                .with_number("height of the part", height, "mm", Some(lens))
        }
        RegistrationError::Contradictory { deviation, worst } => {
            let worst = worst.map_or(String::new(), |index| format!(" The worst is {}.", pair(index)));
            Reason::new(
                "measurement-contradicts",
                format!("{error}.{worst}"),
                "Check the order of the pairs, the unit of the part and the height of the fixture, and measure again.",
            )
            .with_number("standard deviation", deviation, "mm", Some(10.0 * contacts.reading))
        }
        _ => pose("Check the points, and give more of them."),
    }
}

/// Why the height of the part is not known, and what follows from that.
fn height_unknown(found: &Registration, height: AssumedHeight) -> String {
    format!(
        "the points do not show the height of the part, and `--z` does not give it: it is assumed near `z_mm` of the settings, at \
         {:.1} mm +- {:.0} mm. Each mm by which it differs moves the part by ({:+.3}, {:+.3}) mm",
        found.fixture.z,
        found.height_deviation.unwrap_or_default(),
        height.shift.x,
        height.shift.y
    )
}

const SHOW_HEIGHT: &str = "give the height with `--z`, or measure points that are far apart, or a third edge opposite to one of the two";

/// Refuses to write a pose with a height that nobody gave.
fn height_not_shown(found: &Registration, height: AssumedHeight) -> Reason {
    let [x, y, _] = found.deviations;
    let what =
        format!("With `--write`, the height of the part must be known: {}.", height_unknown(found, height));
    Reason::new("pose-not-determined", what, SHOW_HEIGHT).with_number(
        "uncertainty of x and y",
        x.hypot(y),
        "mm",
        None,
    )
}

/// Observations that scatter this many times as much as stated are worth a warning.
const NOTABLE: f64 = 3.0;
/// The same, if a tilt of the part explains it.
const NOTABLE_WITH_TILT: f64 = 2.0;

fn changes(found: &Registration) -> Vec<Change> {
    let exact = |value: f64| NewValue::Number((value * 1000.0).round() / 1000.0 + 0.0);
    let fixture = &found.fixture;
    vec![
        ("x_mm", exact(fixture.x)),
        ("y_mm", exact(fixture.y)),
        ("z_mm", exact(fixture.z)),
        ("rotation_deg", exact(fixture.rotation.to_degrees())),
    ]
}

fn document(
    station: &Station,
    contacts: &Contacts,
    found: &Registration,
    changes: &[Change],
) -> RegistrationDocument {
    let [x, y, rotation] = found.deviations;
    let mut notices = Vec::new();
    if let Some(index) = found.left_out {
        let [off_x, off_y]: [f64; 2] = found.residuals[index].into();
        let hit = contacts.points[index].hit;
        let message = format!(
            "pair {} with the field point ({:.2}, {:.2}) mm contradicts the others by ({off_x:+.2}, {off_y:+.2}) mm; they predict \
             ({:.2}, {:.2}) mm. It was left out",
            index + 1,
            hit.x,
            hit.y,
            hit.x - off_x,
            hit.y - off_y
        );
        notices.push(Notice::warning("measurement-contradicts", message));
    }
    if let Some(height) = found.assumed_height {
        let message = format!("{}; {SHOW_HEIGHT}", height_unknown(found, height));
        notices.push(Notice::warning("height-assumed", message));
    }
    let notable = if found.tilt.is_some() { NOTABLE_WITH_TILT } else { NOTABLE };
    if found.spare > 0 && found.reading > notable * contacts.reading {
        let sizes = found.residuals.iter().map(|residual| residual.norm()).enumerate();
        let used = sizes.filter(|(index, size)| size.is_finite() && found.left_out != Some(*index));
        let worst = used.max_by(|one, other| one.1.total_cmp(&other.1));
        let worst =
            worst.map_or(String::new(), |(index, size)| format!("; pair {} is {size:.2} mm off", index + 1));
        let message = format!(
            "the observations scatter by {:.2} mm, {:.0} times as much as `--reading` states{worst}: {}",
            found.reading,
            found.reading / contacts.reading,
            match found.tilt {
                Some(tilt) => format!(
                    "the part is probably tilted by {:.1} deg, which x, y, z and a rotation do not describe. Put it level; or check the \
                     values, of which one may be mistyped",
                    tilt.to_degrees()
                ),
                None => "one of them is probably mistyped".to_owned(),
            }
        );
        notices.push(Notice::warning("measurement-contradicts", message));
    }
    RegistrationDocument {
        schema: SCHEMA,
        program: program(),
        station: station.name.clone(),
        x_mm: Measured { value: found.fixture.x, deviation: x },
        y_mm: Measured { value: found.fixture.y, deviation: y },
        z_mm: MaybeMeasured { value: found.fixture.z, deviation: found.height_deviation },
        rotation_deg: Measured {
            value: found.fixture.rotation.to_degrees(),
            deviation: rotation.to_degrees(),
        },
        reading_mm: found.reading,
        spare: found.spare,
        residuals_mm: found.residuals.iter().map(|residual| (*residual).into()).collect(),
        edge_residuals_mm: found.edge_residuals.clone(),
        settings: changes.iter().filter_map(|(key, value)| value.line(key)).collect(),
        notices,
    }
}

/// `height` states where a height comes from that was not found.
fn text(document: &RegistrationDocument, height: &str, written: Option<&Path>) -> String {
    let mut text = format!("{}: the part under the laser\n", on_one_line(&document.station));
    let mut line = |label: &str, value: &str| {
        let _ = writeln!(text, "  {label:<18}{value}");
    };
    let measured = |number: &Measured, unit: &str| {
        format!("{:.3} {unit} +- {:.3} {unit}", number.value, number.deviation)
    };
    line("x", &measured(&document.x_mm, "mm"));
    line("y", &measured(&document.y_mm, "mm"));
    line(
        "z",
        &match document.z_mm.deviation {
            Some(deviation) if height == "assumed" => {
                format!("{:.3} mm +- {deviation:.3} mm, assumed", document.z_mm.value)
            }
            Some(deviation) => format!("{:.3} mm +- {deviation:.3} mm", document.z_mm.value),
            None => format!("{:.3} mm, {height}", document.z_mm.value),
        },
    );
    line("rotation", &measured(&document.rotation_deg, "deg"));
    line(
        "one observation",
        &format!("+- {:.3} mm, {} more values than needed", document.reading_mm, document.spare),
    );
    for (index, [x, y]) in document.residuals_mm.iter().enumerate() {
        line(&format!("pair {}", index + 1), &format!("off by {x:+.3}, {y:+.3} mm"));
    }
    for (index, off) in document.edge_residuals_mm.iter().enumerate() {
        line(&format!("edge point {}", index + 1), &format!("off by {off:+.3} mm"));
    }
    station_edit::add_notices(&mut text, &document.notices);
    station_edit::add_lines(&mut text, written, "fixture", &document.settings);
    text
}

/// The outline of the part as a drawing for a plate, with the height of the plate, mm.
fn jig(part: &TriMesh, settings: &JobSettings, plate: Option<f64>) -> Result<(MarkingDrawing, f64), Failure> {
    let view = settings.part.view();
    let lowest = part.positions().iter().map(|corner| view.point(*corner).z).fold(f64::INFINITY, f64::min);
    let plate = plate.unwrap_or(settings.fixture.z + lowest);
    let head = settings.scan_head();
    let mut extents = Extents::EMPTY;
    let mut paths = Vec::new();
    for outline in silhouette(part, &view) {
        let corners = outline.iter().zip(outline.iter().cycle().skip(1));
        let pieces = corners.flat_map(|(from, to)| {
            let steps = (from.distance(*to) / PIECE).ceil().max(1.0) as usize;
            (0..steps).map(move |step| from.lerp(*to, step as f64 / steps as f64))
        });
        let aim = |at: ViewPoint| {
            let on_plate = settings.fixture.point(Point3::new(at.x, at.y, 0.0)).xy().coords.push(plate);
            head.aim(on_plate.into())
        };
        let points: Option<Vec<FieldPoint>> = pieces.map(aim).collect();
        let points = points.ok_or_else(|| {
            let lens = head.lens.height();
            Failure::rejected(
                Reason::new(
                    "part-above-lens",
                    "The plate is as high as the lens, or outside the beams of the lens table.",
                    "Check `--plate`, `z_mm` under [fixture] and the lens distances under [optics].",
                )
                .with_number("height of the plate", plate, "mm", Some(lens)),
            )
        })?;
        points.iter().for_each(|point| extents.include(point.coords()));
        paths.push(MarkingPath { layer: 0, color: Color::ByLayer, shape: MarkingShape::Closed(points) });
    }
    if let Some(field) = settings.field.map(|field| field.extents())
        && !(field.contains(extents.min) && field.contains(extents.max))
    {
        let beyond = (field.min - extents.min).sup(&(extents.max - field.max)).max();
        return Err(Failure::rejected(
            Reason::new(
                "outside-field",
                "The outline of the part is not inside the field.",
                "Move the part towards the middle of the field (`x_mm`, `y_mm` under [fixture]), or use a smaller part of it as a stop.",
            )
            .with_number("overhang", beyond, "mm", Some(0.0)),
        ));
    }
    let layers = vec![Layer { name: "OUTLINE".into(), color: Color::Aci(7) }];
    let comments = vec![format!("isomark outline for a plate at {plate:.3} mm")];
    Ok((MarkingDrawing { layers, paths, comments }, plate))
}
