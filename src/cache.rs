//! Fitted surfaces on disk, one folder for each SKU, so that a pattern for a known SKU needs no mesh.
//!
//! ```text
//! <cache>/parts/<sku>.toml    the current part of the SKU and when it became it, the same for all versions
//! <cache>/v35/                one folder for each format version
//! └── <sku>/
//!     ├── current.toml        the current part of the SKU, for versions that do not read `parts`
//!     ├── <key>.fit           a fitted surface: header, BLAKE3 of the body, body
//!     ├── <key>.mesh          the part's mesh for pictures, in the same form; may be missing
//!     └── <key>.toml          a summary for people: origin and residual
//! ```
//!
//! The key is the BLAKE3 hash of the part's bytes, of the settings that affect the surface, as
//! [`canonical::surface`](crate::config::canonical::surface) writes them, and of the version of the fit. A `.fit`
//! file is written once, completely, and never changed, so several stations may share a cache folder. A damaged file,
//! for example after a power cut, is reported and treated as missing: the surface is fitted again.

mod shared;
mod task;

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use fs_err as fs;
use nalgebra::Vector2;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::config::Sku;
use crate::files::{now_ms, read_if_there, write_whole_or_not, write_whole_unsynced, written_at_ms};
use crate::formats::mesh::PartFacts;
use crate::geometry::facing_part::Uncertainty;
use crate::geometry::height_field::{HeightField, Node};
use crate::geometry::mark_region::MarkRegion;
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::surface::fit::{FittedSurface, Window};
use crate::geometry::surface::knots::UniformKnots;
use crate::geometry::surface::nurbs::NurbsSurface;

pub(crate) use shared::Shared;
pub use shared::SharedSurfaces;
pub use task::FitTask;

/// Version of the file format and of the fit: increased whenever either changes.
const VERSION: u32 = 39;
const MAGIC: &[u8; 12] = b"isomark fit\n";
const MESH_MAGIC: &[u8; 12] = b"isomark mesh";
/// Magic, version, hash of the body.
const HEADER: usize = MAGIC.len() + 4 + blake3::OUT_LEN;
const CURRENT: &str = "current.toml";
/// The folder of the current parts, beside the folders of the versions.
const PARTS: &str = "parts";

/// A folder of fitted surfaces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    root: PathBuf,
}

/// The name of a surface: a hash of the part and the settings of the fit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct CacheKey(String);

/// The origin of a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PartOrigin {
    /// The part file's name.
    pub file: String,
    /// BLAKE3 hash of the part's bytes and of its buffers', in hexadecimal.
    pub blake3: String,
}

/// The current part of a SKU.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CurrentPart {
    /// File and hash.
    #[serde(flatten)]
    pub origin: PartOrigin,
    /// Whether the file contains a marking frame.
    #[serde(default, skip_serializing_if = "is_false")]
    pub has_frame: bool,
    /// Its place in the order of a fleet; `None` for a part that no fleet knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<PartOrder>,
}

/// The place of a part in the order that all stations of a fleet agree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PartOrder {
    /// When the tables of the fleet were made, µs since 1970 by the clock of the database: this tells fleets apart.
    pub fleet_us: i64,
    /// Its number among the parts of the SKU.
    pub version: i64,
    /// When it got this number, µs since 1970 by the clock of the database. A database that was lost gives it again, later.
    pub announced_us: i64,
    /// When it was learned, ms since 1970 by the clock of this computer.
    pub learned_ms: u64,
}

/// The current part of a SKU, and when it became it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DatedPart {
    /// The part.
    pub part: CurrentPart,
    /// When it became the current one, ms since 1970. A part that becomes it later always has a larger number, also if
    /// the clocks of the stations that share the cache differ.
    pub learned_ms: u64,
    /// Whether the moment is recorded. Otherwise it is the time of a file that an older version wrote, and a copy of the
    /// cache may have changed it.
    pub is_recorded: bool,
}

/// The current part of a SKU in the record for all versions.
#[derive(Serialize, Deserialize)]
struct PartRecord {
    learned_ms: u64,
    #[serde(flatten)]
    part: CurrentPart,
}

fn is_false(flag: &bool) -> bool {
    !flag
}

/// A cached surface with its origin.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CachedSurface {
    /// The part it was fitted to.
    pub origin: PartOrigin,
    /// Facts about the part's file.
    pub facts: PartFacts,
    /// The fitted surface with its samples.
    pub surface: FittedSurface,
    /// Where ink may be; `None` for anywhere.
    pub mark: Option<MarkRegion>,
}

/// A surface as bytes, for another cache.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct KeptBytes {
    /// The surface.
    pub fit: Vec<u8>,
    /// The part's mesh for pictures, if there is one.
    pub mesh: Option<Vec<u8>>,
}

/// The result of a cache lookup.
#[derive(Debug)]
#[non_exhaustive]
pub enum Lookup {
    /// The surface.
    Hit(Box<CachedSurface>),
    /// There is no entry.
    Miss,
    /// The file cannot be used, for this reason.
    Damaged(String),
}

/// One entry, as `isomark cache list` shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CacheEntry {
    /// The SKU's folder name.
    pub sku: String,
    /// The entry's name.
    pub key: CacheKey,
    /// Size of its files, bytes.
    pub bytes: u64,
    /// Whether this is the current part of the SKU.
    pub current: bool,
    /// The part's file name, or why the entry cannot be used.
    pub state: EntryState,
}

/// Whether an entry can be used.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EntryState {
    /// It can be used.
    Good {
        /// The part's file name.
        part: String,
        /// Largest distance between part and fit, mm.
        residual_mm: f64,
    },
    /// It cannot be used, for this reason; the next job fits the surface again.
    Damaged(String),
}

/// What a kept surface holds; [`decode`] reads the fields in this order.
#[derive(Serialize)]
struct Record {
    origin: PartOrigin,
    /// As JSON: facts may gain fields, which postcard could not skip.
    facts: String,
    whole: SurfaceRecord,
    windows: Vec<WindowRecord>,
    /// One distance for each node, or none at all.
    mark: Vec<f32>,
}

#[derive(Serialize)]
struct SurfaceRecord {
    knots_x: (f64, f64, usize),
    knots_y: (f64, f64, usize),
    heights: Vec<f64>,
    field_origin: [f64; 2],
    field_step: f64,
    field_columns: usize,
    field_rows: usize,
    /// 0 empty, 1 wall, 2 surface.
    node_kinds: Vec<u8>,
    /// One for each wall or surface node.
    node_heights: Vec<f64>,
    /// Number of nodes and their face. All nodes, or none at all.
    faces: Vec<(usize, u32)>,
    /// One for each node, or none at all.
    doubts: Vec<f64>,
    /// Number of nodes, slope and height: most nodes are as those beside them. All nodes, or none at all.
    uncertainties: Vec<(usize, f32, f32)>,
    /// Some nodes, slope and height: what is not known without what is beyond an edge.
    alone: Vec<(usize, f32, f32)>,
}

#[derive(Serialize)]
struct WindowRecord {
    level: usize,
    first: [usize; 2],
    core: [Range<usize>; 2],
    surface: SurfaceRecord,
}

#[derive(Serialize, Deserialize)]
struct MeshRecord {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    source_triangles: usize,
}

#[derive(Serialize, Deserialize)]
struct Sidecar {
    part: PartOrigin,
    program: String,
    control_points: [usize; 2],
    span_mm: f64,
    size_mm: [f64; 3],
    residual_largest_mm: f64,
    residual_rms_mm: f64,
}

impl KeptBytes {
    /// The bytes of a surface, as a cache keeps it, with the part's mesh for pictures if there is one.
    ///
    /// # Errors
    /// When its values cannot be written.
    pub fn of(kept: &CachedSurface, mesh: Option<&PictureMesh>) -> io::Result<Self> {
        Ok(Self { fit: encode(kept)?, mesh: mesh.map(encode_mesh).transpose()? })
    }
}

impl CurrentPart {
    /// A part that becomes a SKU's current one.
    #[must_use]
    pub fn new(origin: PartOrigin, has_frame: bool) -> Self {
        Self { origin, has_frame, order: None }
    }

    /// The same with its place in the order of a fleet.
    #[must_use]
    pub fn in_order(self, order: PartOrder) -> Self {
        Self { order: Some(order), ..self }
    }
}

impl CacheKey {
    /// The key of a part (its hash, see [`PartOrigin`]) under settings as
    /// [`canonical::surface`](crate::config::canonical::surface) writes them.
    #[must_use]
    pub fn new(part_blake3: &str, settings: &str) -> Self {
        let text = format!("isomark fit {VERSION}\n{part_blake3}\n{settings}");
        Self(blake3::hash(text.as_bytes()).to_hex()[..32].to_owned())
    }

    /// What makes a fit another one for the same part and settings: the program, and the version of its fits.
    #[must_use]
    pub fn maker() -> String {
        format!("isomark {} with fits of version {VERSION}", env!("CARGO_PKG_VERSION"))
    }

    /// The key as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Cache {
    /// The cache in `root`, a folder that is created when the first surface is kept.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The folder of the cache.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn folder(&self, sku: &Sku) -> PathBuf {
        self.version_folder().join(sku.key())
    }

    fn version_folder(&self) -> PathBuf {
        self.root.join(format!("v{VERSION}"))
    }

    /// The folders of all versions in this cache.
    fn version_folders(&self) -> io::Result<Vec<PathBuf>> {
        let mut folders = sorted_names(&self.root)?;
        folders.retain(|folder| {
            let name = name_of(folder);
            let number = name.strip_prefix('v').unwrap_or_default();
            !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())
        });
        Ok(folders)
    }

    fn part_record(&self, sku: &Sku) -> PathBuf {
        self.root.join(PARTS).join(format!("{}.toml", sku.key()))
    }

    /// The current part of a SKU; `None` for an unknown SKU.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn current(&self, sku: &Sku) -> io::Result<Option<CurrentPart>> {
        Ok(self.dated_current(sku)?.map(|dated| dated.part))
    }

    /// The current part of a SKU, and when it became it; `None` for an unknown SKU. A part that an older version of
    /// isomark made the current one since is it here, too, although its surface is of no use to this version.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn dated_current(&self, sku: &Sku) -> io::Result<Option<DatedPart>> {
        let record = self.part_record(sku);
        // A damaged file is treated as missing: the part is dropped again or found in the archive.
        let recorded = read_if_there(&record)?.and_then(|bytes| from_toml::<PartRecord>(&bytes));
        let has_record = recorded.is_some();
        let mut written_ms = match recorded {
            Some(_) => written_at_ms(&record)?,
            None => None,
        };
        let mut newest =
            recorded.map(|PartRecord { learned_ms, part }| DatedPart { part, learned_ms, is_recorded: true });
        // This version writes the files of all versions, and the record last: what is newer than that, and other, is of
        // a version that does not know the record.
        for folder in self.version_folders()? {
            let file = folder.join(sku.key()).join(CURRENT);
            let Some(at_ms) = written_at_ms(&file)?.filter(|at_ms| Some(*at_ms) > written_ms) else {
                continue;
            };
            let Some(part) = read_if_there(&file)?.and_then(|bytes| from_toml::<CurrentPart>(&bytes)) else {
                continue;
            };
            newest = Some(match newest {
                Some(known) if known.part.origin.blake3 == part.origin.blake3 => {
                    let order = part.order.or(known.part.order);
                    DatedPart { part: CurrentPart { order, ..known.part }, ..known }
                }
                known => {
                    let learned_ms = known.map_or(at_ms, |known| at_ms.max(known.learned_ms + 1));
                    DatedPart { part, learned_ms, is_recorded: has_record }
                }
            });
            written_ms = Some(at_ms);
        }
        Ok(newest)
    }

    /// Looks up a surface.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn get(&self, sku: &Sku, key: &CacheKey) -> io::Result<Lookup> {
        let Some(bytes) = read_if_there(&self.file(sku, key, "fit"))? else {
            return Ok(Lookup::Miss);
        };
        Ok(match decode(&bytes) {
            Ok(surface) => Lookup::Hit(Box::new(surface)),
            Err(what) => Lookup::Damaged(what),
        })
    }

    /// The mesh for pictures that is kept beside a surface; `None` if there is none that can be used. A picture can do
    /// without it.
    #[must_use]
    pub fn picture_mesh(&self, sku: &Sku, key: &CacheKey) -> Option<PictureMesh> {
        let bytes = read_if_there(&self.file(sku, key, "mesh")).ok().flatten()?;
        decode_mesh(&bytes)
    }

    /// Whether a mesh for pictures is kept beside a surface.
    #[must_use]
    pub fn has_picture_mesh(&self, sku: &Sku, key: &CacheKey) -> bool {
        self.file(sku, key, "mesh").exists()
    }

    /// Stores the mesh for pictures beside a surface.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn keep_picture_mesh(&self, sku: &Sku, key: &CacheKey, mesh: &PictureMesh) -> io::Result<()> {
        let folder = self.folder(sku);
        fs::create_dir_all(&folder)?;
        write_whole_unsynced(&folder, &format!("{}.mesh", key.0), &encode_mesh(mesh)?)
    }

    /// The bytes of a surface and of its mesh for pictures, if there are any; they are not checked.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn bytes(&self, sku: &Sku, key: &CacheKey) -> io::Result<Option<KeptBytes>> {
        let Some(fit) = read_if_there(&self.file(sku, key, "fit"))? else { return Ok(None) };
        Ok(Some(KeptBytes { fit, mesh: read_if_there(&self.file(sku, key, "mesh"))? }))
    }

    /// Stores a surface whose [bytes](Self::bytes) come from another cache, if it is a surface of this part. A mesh that cannot
    /// be used is left out. The inner error is what is wrong with the surface.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn take_in(
        &self,
        sku: &Sku,
        key: &CacheKey,
        part: &PartOrigin,
        fit: &[u8],
        mesh: Option<&[u8]>,
    ) -> io::Result<Result<(), String>> {
        let kept = match decode(fit) {
            Ok(kept) if kept.origin.blake3 == part.blake3 => CachedSurface { origin: part.clone(), ..kept },
            Ok(_) => return Ok(Err("it is the surface of another part".into())),
            Err(what) => return Ok(Err(what)),
        };
        self.keep(sku, key, &kept, mesh.and_then(decode_mesh).as_ref()).map(Ok)
    }

    fn file(&self, sku: &Sku, key: &CacheKey, ending: &str) -> PathBuf {
        self.folder(sku).join(format!("{}.{ending}", key.0))
    }

    /// Stores a surface, with the part's mesh for pictures if there is one; [`make_current`](Self::make_current) makes its
    /// part the SKU's current one.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn keep(
        &self,
        sku: &Sku,
        key: &CacheKey,
        kept: &CachedSurface,
        mesh: Option<&PictureMesh>,
    ) -> io::Result<()> {
        let folder = self.folder(sku);
        fs::create_dir_all(&folder)?;
        // The mesh first: whoever finds the surface finds both.
        if let Some(mesh) = mesh {
            self.keep_picture_mesh(sku, key, mesh)?;
        }
        write_whole_unsynced(&folder, &format!("{}.fit", key.0), &encode(kept)?)?;
        let (knots_x, knots_y) = kept.surface.nurbs.knots();
        let sidecar = Sidecar {
            part: kept.origin.clone(),
            program: format!("isomark {}", env!("CARGO_PKG_VERSION")),
            control_points: [knots_x.control_points(), knots_y.control_points()],
            span_mm: knots_x.step(),
            size_mm: kept.facts.size,
            residual_largest_mm: kept.surface.residual.max,
            residual_rms_mm: kept.surface.residual.rms,
        };
        write_whole_unsynced(&folder, &format!("{}.toml", key.0), to_toml(&sidecar)?.as_bytes())
    }

    /// Makes a part the current part of the SKU from now on. One without an order keeps the order that it had.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn make_current(&self, sku: &Sku, part: &CurrentPart) -> io::Result<()> {
        let known = self.dated_current(sku)?;
        let learned_ms = known.as_ref().map_or(0, |known| known.learned_ms + 1).max(now_ms());
        let part = with_known_order(part, known.as_ref());
        // Of a part that is the current one already, only the moment would be lost.
        let is_known = known.is_some_and(|known| known.part == part);
        let write = if is_known { write_whole_unsynced } else { write_whole_or_not };
        let written = self.write_current(sku, &part, learned_ms, write);
        if is_known { Ok(()) } else { written }
    }

    /// Makes a part the current part of the SKU that became it at this moment, ms since 1970, and was lost here. Returns
    /// whether it is the current one now: a part that became it later stays.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn make_current_as_of(&self, sku: &Sku, part: &CurrentPart, learned_ms: u64) -> io::Result<bool> {
        let known = self.dated_current(sku)?;
        let part = with_known_order(part, known.as_ref());
        let mut moment = learned_ms;
        if let Some(known) = known {
            let is_same = known.part.origin.blake3 == part.origin.blake3;
            if is_same && known.is_recorded && known.part == part && known.learned_ms >= learned_ms {
                return Ok(true);
            }
            if !is_same && known.is_recorded && known.learned_ms > learned_ms {
                return Ok(false);
            }
            if is_same {
                moment = moment.max(known.learned_ms);
            }
        }
        self.write_current(sku, &part, moment, write_whole_or_not).map(|()| true)
    }

    /// Writes the current part for all versions: those that do not read the record would otherwise mark on an older part after a change
    /// of the version, or at another station. `write` writes the record; it must flush if a power cut could restore an older part.
    fn write_current(
        &self,
        sku: &Sku,
        part: &CurrentPart,
        learned_ms: u64,
        write: fn(&Path, &str, &[u8]) -> io::Result<()>,
    ) -> io::Result<()> {
        let text = to_toml(part)?;
        for folder in self.version_folders()? {
            let folder = folder.join(sku.key());
            let known = read_if_there(&folder.join(CURRENT))?;
            if known.is_some_and(|known| known != text.as_bytes()) {
                write_whole_unsynced(&folder, CURRENT, text.as_bytes())?;
            }
        }
        let own = self.folder(sku);
        if !own.join(CURRENT).exists() {
            fs::create_dir_all(&own)?;
            write_whole_unsynced(&own, CURRENT, text.as_bytes())?;
        }
        let parts = self.root.join(PARTS);
        fs::create_dir_all(&parts)?;
        let record = PartRecord { learned_ms, part: part.clone() };
        write(&parts, &format!("{}.toml", sku.key()), to_toml(&record)?.as_bytes())
    }

    /// The SKUs that have a current part, by their keys.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn skus(&self) -> io::Result<BTreeMap<String, Sku>> {
        let own = sorted_names(&self.version_folder())?;
        let own = own.iter().filter(|folder| folder.join(CURRENT).exists()).map(|folder| name_of(folder));
        let recorded = sorted_names(&self.root.join(PARTS))?;
        let recorded =
            recorded.iter().filter_map(|file| name_of(file).strip_suffix(".toml").map(str::to_owned));
        let skus = own.chain(recorded).filter_map(|key| {
            let sku = key.parse::<Sku>().ok().filter(|sku| sku.key() == key)?;
            Some((key, sku))
        });
        Ok(skus.collect())
    }

    /// When the current part of a SKU became it in this cache, ms since 1970; `None` for an unknown SKU.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn current_since_ms(&self, sku: &Sku) -> io::Result<Option<u64>> {
        Ok(self.dated_current(sku)?.map(|dated| dated.learned_ms))
    }

    /// The keys of the surfaces of a SKU that belong to the part with this hash, by their summaries.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn keys_of(&self, sku: &Sku, part_blake3: &str) -> io::Result<Vec<CacheKey>> {
        let files = sorted_names(&self.folder(sku))?;
        let fits = files.into_iter().filter(|file| file.extension().is_some_and(|ending| ending == "fit"));
        let mut keys = Vec::new();
        for file in fits {
            let Some(bytes) = read_if_there(&file.with_extension("toml"))? else { continue };
            let sidecar =
                std::str::from_utf8(&bytes).ok().and_then(|text| toml::from_str::<Sidecar>(text).ok());
            if sidecar.is_some_and(|sidecar| sidecar.part.blake3 == part_blake3) {
                keys.push(CacheKey(file.file_stem().unwrap_or_default().to_string_lossy().into_owned()));
            }
        }
        Ok(keys)
    }

    /// All entries, ordered by SKU and key; each is read and checked.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn entries(&self) -> io::Result<Vec<CacheEntry>> {
        let mut entries = Vec::new();
        for folder in sorted_names(&self.version_folder())? {
            let current = match name_of(&folder).parse::<Sku>() {
                Ok(sku) => self.current(&sku)?.map(|current| current.origin),
                Err(_) => None,
            };
            for file in
                sorted_names(&folder)?.into_iter().filter(|file| file.extension().is_some_and(|e| e == "fit"))
            {
                let Some(bytes) = read_if_there(&file)? else { continue };
                let decoded = decode(&bytes);
                let mesh = fs::metadata(file.with_extension("mesh")).map_or(0, |mesh| mesh.len());
                entries.push(CacheEntry {
                    sku: name_of(&folder),
                    key: CacheKey(file.file_stem().unwrap_or_default().to_string_lossy().into_owned()),
                    bytes: bytes.len() as u64 + mesh,
                    current: decoded.as_ref().is_ok_and(|kept| Some(&kept.origin) == current.as_ref()),
                    state: match decoded {
                        Ok(kept) => EntryState::Good {
                            part: kept.origin.file,
                            residual_mm: kept.surface.residual.max,
                        },
                        Err(what) => EntryState::Damaged(what),
                    },
                });
            }
        }
        Ok(entries)
    }

    /// Removes all entries of a SKU, of all versions, and its current part; returns whether there were any.
    ///
    /// # Errors
    /// When the folder cannot be removed.
    pub fn remove(&self, sku: &Sku) -> io::Result<bool> {
        let mut was_there = false;
        // The record last: without it, the part of an older version would be the current one.
        for folder in self.version_folders()? {
            was_there |= is_removed(fs::remove_dir_all(folder.join(sku.key())))?;
        }
        Ok(was_there | is_removed(fs::remove_file(self.part_record(sku)))?)
    }

    /// Removes one entry.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub fn remove_entry(&self, entry: &CacheEntry) -> io::Result<()> {
        let folder = self.version_folder().join(&entry.sku);
        for ending in ["fit", "toml", "mesh"] {
            is_removed(fs::remove_file(folder.join(format!("{}.{ending}", entry.key.0))))?;
        }
        Ok(())
    }
}

/// Whether something was there to be removed.
fn is_removed(removed: io::Result<()>) -> io::Result<bool> {
    match removed {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// A part with the order in a fleet that it had, if it has none.
fn with_known_order(part: &CurrentPart, known: Option<&DatedPart>) -> CurrentPart {
    let known =
        known.filter(|known| known.part.origin == part.origin && known.part.has_frame == part.has_frame);
    let order = part.order.or(known.and_then(|known| known.part.order));
    CurrentPart { order, ..part.clone() }
}

fn from_toml<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    std::str::from_utf8(bytes).ok().and_then(|text| toml::from_str(text).ok())
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn sorted_names(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let listing = match fs::read_dir(folder) {
        Ok(listing) => listing,
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(Vec::new());
        }
        Err(error) => return Err(error),
    };
    let mut paths = listing.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<_>>>()?;
    paths.retain(|path| !name_of(path).starts_with('.'));
    paths.sort();
    Ok(paths)
}

fn to_toml(value: &impl Serialize) -> io::Result<String> {
    toml::to_string(value).map_err(io::Error::other)
}

fn encode(kept: &CachedSurface) -> io::Result<Vec<u8>> {
    let windows = kept.surface.windows().iter().map(|window| WindowRecord {
        level: window.level,
        first: window.first,
        core: window.core.clone(),
        surface: SurfaceRecord::of(&window.surface),
    });
    let record = Record {
        origin: kept.origin.clone(),
        facts: serde_json::to_string(&kept.facts).map_err(io::Error::other)?,
        whole: SurfaceRecord::of(&kept.surface),
        windows: windows.collect(),
        mark: kept.mark.as_ref().map(|mark| mark.distances().to_vec()).unwrap_or_default(),
    };
    sealed(&record, MAGIC)
}

impl SurfaceRecord {
    fn of(surface: &FittedSurface) -> Self {
        let knots = |knots: UniformKnots| (knots.start(), knots.step(), knots.spans());
        let (knots_x, knots_y) = surface.nurbs.knots();
        let field = &surface.field;
        let (field_columns, field_rows) = field.size();
        let kind = |node: &Node| match node {
            Node::Empty => 0,
            Node::Wall(_) => 1,
            Node::Surface(_) => 2,
        };
        let height = |node: &Node| match node {
            Node::Empty => None,
            Node::Wall(height) | Node::Surface(height) => Some(*height),
        };
        let alike = surface.uncertainties().chunk_by(|one, other| one == other);
        Self {
            knots_x: knots(knots_x),
            knots_y: knots(knots_y),
            heights: surface.nurbs.heights().to_vec(),
            field_origin: field.origin().into(),
            field_step: field.step(),
            field_columns,
            field_rows,
            node_kinds: field.nodes().iter().map(kind).collect(),
            node_heights: field.nodes().iter().filter_map(height).collect(),
            faces: field.faces().chunk_by(|one, other| one == other).map(|run| (run.len(), run[0])).collect(),
            doubts: surface.doubts().to_vec(),
            uncertainties: alike.map(|run| (run.len(), run[0].slope, run[0].height)).collect(),
            alone: surface.alone().iter().map(|(node, of)| (*node, of.slope, of.height)).collect(),
        }
    }
}

fn encode_mesh(mesh: &PictureMesh) -> io::Result<Vec<u8>> {
    let record = MeshRecord {
        positions: mesh.positions().to_vec(),
        normals: mesh.normals().to_vec(),
        triangles: mesh.triangles().to_vec(),
        source_triangles: mesh.source_triangles(),
    };
    sealed(&record, MESH_MAGIC)
}

/// A record as bytes: header, hash of the body, body.
fn sealed(record: &impl Serialize, magic: &[u8; 12]) -> io::Result<Vec<u8>> {
    let body = postcard::to_stdvec(record).map_err(io::Error::other)?;
    let mut bytes = Vec::with_capacity(HEADER + body.len());
    bytes.extend_from_slice(magic);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(blake3::hash(&body).as_bytes());
    bytes.extend_from_slice(&body);
    Ok(bytes)
}

/// The body in the bytes, if they are undamaged and of this version.
fn opened<'a>(bytes: &'a [u8], magic: &[u8; 12]) -> Result<Body<'a>, String> {
    let (Some(header), Some(body)) = (bytes.get(..HEADER), bytes.get(HEADER..)) else {
        return Err(format!("the file is truncated: {} bytes", bytes.len()));
    };
    if !header.starts_with(magic) || header[MAGIC.len()..MAGIC.len() + 4] != VERSION.to_le_bytes() {
        return Err("the header does not match this version".into());
    }
    if header[MAGIC.len() + 4..] != *blake3::hash(body).as_bytes() {
        return Err("the checksum does not match the content".into());
    }
    Ok(Body(body))
}

/// What is not read yet of a body.
struct Body<'a>(&'a [u8]);

impl<'a> Body<'a> {
    fn next<T: Deserialize<'a>>(&mut self) -> Result<T, String> {
        let unreadable = |error| format!("the body cannot be read: {error}");
        let (value, rest) = postcard::take_from_bytes(self.0).map_err(unreadable)?;
        self.0 = rest;
        Ok(value)
    }

    /// A list whose elements have `SIZE` bytes each, without looking at every element: in postcard, the length is followed by the
    /// elements, and floating-point numbers are little-endian.
    fn list<const SIZE: usize>(&mut self) -> Result<&'a [[u8; SIZE]], String> {
        let length: usize = self.next()?;
        let split = length.checked_mul(SIZE).and_then(|bytes| self.0.split_at_checked(bytes));
        let (list, rest) = split.ok_or("the body cannot be read: a list is truncated")?;
        self.0 = rest;
        Ok(list.as_chunks().0)
    }

    fn numbers(&mut self) -> Result<Vec<f64>, String> {
        Ok(self.list()?.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }

    /// A [`SurfaceRecord`].
    fn surface(&mut self) -> Result<FittedSurface, String> {
        let mut knots = || -> Result<UniformKnots, String> {
            let (start, step, spans): (f64, f64, usize) = self.next()?;
            let is_valid = step > 0.0 && (1..1_000_000).contains(&spans);
            is_valid
                .then(|| UniformKnots::new(start, step, spans))
                .ok_or_else(|| "invalid knot vector".into())
        };
        let (knots_x, knots_y) = (knots()?, knots()?);
        let heights = self.numbers()?;
        let (origin_of_field, step): ([f64; 2], f64) = (self.next()?, self.next()?);
        let (columns, rows) = (self.next()?, self.next()?);
        let kinds: &[[u8; 1]] = self.list()?;
        let mut known = self.list()?.iter().map(|bytes| f64::from_le_bytes(*bytes));
        let mut next = || known.next().unwrap_or(f64::NAN);
        let node = |[kind]: &[u8; 1]| match kind {
            0 => Node::Empty,
            1 => Node::Wall(next()),
            _ => Node::Surface(next()),
        };
        let nodes: Vec<Node> = kinds.iter().map(node).collect();
        let faces = runs(self.next::<Vec<(usize, u32)>>()?, nodes.len())?;
        let doubts = self.numbers()?;
        let uncertain = self.next::<Vec<(usize, f32, f32)>>()?.into_iter();
        let uncertain =
            uncertain.map(|(count, slope, height)| (count, Uncertainty { slope, height })).collect();
        let uncertainties = runs(uncertain, nodes.len())?;
        let alone = self.next::<Vec<(usize, f32, f32)>>()?.into_iter();
        let alone = alone.map(|(node, slope, height)| (node, Uncertainty { slope, height })).collect();
        let nurbs = NurbsSurface::new(knots_x, knots_y, heights);
        let field = HeightField::new(Vector2::from(origin_of_field), step, columns, rows, nodes);
        let (Some(nurbs), Some(field)) = (nurbs, field) else {
            return Err("the sizes of the grids do not match".into());
        };
        Ok(FittedSurface::compare(nurbs, field.with_faces(faces))
            .doubted(doubts, uncertainties)
            .with_alone(alone))
    }
}

/// What each of these many nodes has, at most, from the numbers of nodes that have the same.
fn runs<T: Clone>(runs: Vec<(usize, T)>, nodes: usize) -> Result<Vec<T>, String> {
    let mut all = Vec::new();
    for (count, value) in runs {
        if count > nodes - all.len() {
            return Err("there are more values than nodes".into());
        }
        all.resize(all.len() + count, value);
    }
    Ok(all)
}

fn decode(bytes: &[u8]) -> Result<CachedSurface, String> {
    let mut body = opened(bytes, MAGIC)?;
    let origin = body.next()?;
    let facts: PartFacts =
        serde_json::from_str(body.next()?).map_err(|error| format!("the facts cannot be read: {error}"))?;
    let surface = body.surface()?;
    let mut windows = Vec::new();
    for _ in 0..body.next::<usize>()? {
        let (level, first, core) = (body.next()?, body.next()?, body.next()?);
        windows.push(Window { level, first, core, surface: body.surface()? });
    }
    let surface = surface.with_windows(windows).ok_or("a window does not match the surface")?;
    let mark: Vec<f32> = body.list()?.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let mark = match mark.is_empty() {
        true => None,
        false => {
            let region = MarkRegion::with_distances(&surface.field, mark);
            Some(region.ok_or_else(|| "the sizes of the grids do not match".to_owned())?)
        }
    };
    let surface = surface.with_known(facts.known_forms()).measured(facts.scan.is_some());
    Ok(CachedSurface { origin, surface, facts, mark })
}

fn decode_mesh(bytes: &[u8]) -> Option<PictureMesh> {
    let record: MeshRecord = opened(bytes, MESH_MAGIC).and_then(|mut body| body.next()).ok()?;
    PictureMesh::new(record.positions, record.normals, record.triangles, record.source_triangles)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::config::canonical::tests::everything;
    use crate::config::{PartSettings, canonical};
    use crate::formats::mesh::{MeshFormat, MeshOptions};
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::FitOptions;

    fn kept() -> CachedSurface {
        let mut obj = String::new();
        for row in 0..12 {
            for column in 0..12 {
                obj += &format!("v {column} {row} {}\n", f64::from(column * row) * 0.02);
            }
        }
        for row in 0..11 {
            for column in 1..12 {
                let lower = row * 12 + column;
                obj += &format!("f {lower} {} {} {}\n", lower + 1, lower + 13, lower + 12);
            }
        }
        let reading = crate::formats::mesh::read(
            obj.as_bytes(),
            MeshFormat::Obj,
            &MeshOptions::default(),
            &BTreeMap::new(),
        )
        .unwrap();
        let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
        let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        let origin = PartOrigin { file: "saddle.obj".into(), blake3: "00".into() };
        let corner = |x, y| nalgebra::Point3::new(x, y, 0.0);
        let faces = [[corner(0.0, 0.0), corner(5.0, 0.0), corner(0.0, 5.0)]];
        let mark = Some(MarkRegion::seen(&faces, &View::top(), &surface.field));
        CachedSurface { origin, facts: reading.facts, surface, mark }
    }

    /// A plate of 120 mm with a cap of a ball of 4 mm in its middle.
    fn with_windows() -> CachedSurface {
        let mut obj = String::from("v 0 0 4\n");
        let rings =
            (1..=8).map(|ring| f64::from(ring) * 0.1).map(|angle| (4.0 * angle.sin(), 4.0 * angle.cos()));
        for (from_axis, z) in rings.chain([(60.0, 4.0 * 0.8f64.cos())]) {
            for sector in 0..24 {
                let (sin, cos) = (f64::from(sector) * std::f64::consts::TAU / 24.0).sin_cos();
                obj += &format!("v {} {} {z}\n", from_axis * cos, from_axis * sin);
            }
        }
        for sector in 0..24 {
            let next = (sector + 1) % 24;
            obj += &format!("f 1 {} {}\n", 2 + sector, 2 + next);
            for ring in 0..8 {
                let [inner, outer] = [2 + 24 * ring, 26 + 24 * ring];
                obj +=
                    &format!("f {} {} {} {}\n", inner + sector, outer + sector, outer + next, inner + next);
            }
        }
        let options = MeshOptions::default();
        let reading =
            crate::formats::mesh::read(obj.as_bytes(), MeshFormat::Obj, &options, &BTreeMap::new()).unwrap();
        let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
        let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        CachedSurface { surface, facts: reading.facts, ..kept() }
    }

    #[test]
    fn a_kept_surface_has_its_windows() {
        let kept = CachedSurface { mark: None, ..with_windows() };
        assert!(!kept.surface.windows().is_empty());
        let bytes = encode(&kept).unwrap();
        let read = decode(&bytes).unwrap();
        assert_eq!(read, kept);
        // One that the part does not have, or that lacks the spans in which it counts, is no window of it.
        for change in [
            (|window: &mut Window| window.level = 60) as fn(&mut Window),
            |window| window.level = 0,
            |window| window.first[0] += 40,
            |window| window.core[1].end += 40,
            |window| window.core[0].start = window.core[0].end,
        ] {
            let mut windows = kept.surface.windows().to_vec();
            change(windows.last_mut().unwrap());
            assert_eq!(kept.surface.clone().with_windows(windows), None);
        }
    }

    /// A change here means that every part is fitted again.
    #[test]
    fn the_key_of_a_surface_is_pinned() {
        let key = |settings: &PartSettings| {
            CacheKey::new("ab12", &canonical::surface(settings, &FitOptions::default())).0
        };
        // BLAKE3 from another program: of "isomark fit 39", "ab12" and the pinned text of the settings, one per line.
        assert_eq!(key(&PartSettings::default()), "f595e24bb6a3b94e2f4ec6a369e227a4");
        assert_eq!(key(&everything().part), "f7d90eb60f96e24e8967055cdb0dc2fd");
    }

    #[test]
    fn a_kept_surface_is_loaded_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path());
        let (sku, key, kept) = ("Saddle".parse::<Sku>().unwrap(), CacheKey::new("00", "top"), kept());
        assert!(matches!(cache.get(&sku, &key).unwrap(), Lookup::Miss));
        assert_eq!(cache.current(&sku).unwrap(), None);
        cache.keep(&sku, &key, &kept, None).unwrap();
        let current = CurrentPart::new(kept.origin.clone(), true);
        assert!(cache.skus().unwrap().is_empty() && cache.current_since_ms(&sku).unwrap().is_none());
        let order = PartOrder { fleet_us: 2, version: 3, announced_us: 4, learned_ms: 5 };
        cache.make_current(&sku, &current.clone().in_order(order)).unwrap();
        // The order stays when the same part is dropped again.
        cache.make_current(&sku, &current).unwrap();
        let current = current.in_order(order);
        assert_eq!(cache.skus().unwrap(), BTreeMap::from([(sku.key().to_owned(), sku.clone())]));
        assert_eq!(cache.keys_of(&sku, &kept.origin.blake3).unwrap(), std::slice::from_ref(&key));
        assert!(cache.keys_of(&sku, "another").unwrap().is_empty());
        let Lookup::Hit(found) = cache.get(&sku, &key).unwrap() else { panic!("a hit") };
        assert_eq!(*found, kept);
        assert_eq!(cache.current(&sku).unwrap(), Some(current));
        assert_eq!(cache.entries().unwrap().len(), 1);
        assert!(cache.remove(&sku).unwrap() && !cache.remove(&sku).unwrap());
    }

    fn part_named(blake3: &str) -> CurrentPart {
        CurrentPart::new(PartOrigin { file: format!("{blake3}.obj"), blake3: blake3.into() }, false)
    }

    fn written_after(path: &Path, earlier: &Path) {
        let earlier = fs::metadata(earlier).unwrap().modified().unwrap();
        let file = fs::OpenOptions::new().write(true).open(path).unwrap();
        file.file().set_modified(earlier + std::time::Duration::from_secs(2)).unwrap();
    }

    /// Another version of isomark, which does not know the record, made the part current since.
    #[test]
    fn all_versions_agree_on_the_current_part() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path());
        let sku: Sku = "Can".parse().unwrap();
        let old = folder.path().join("v7/can");
        let write_old = |blake3: &str| {
            fs::create_dir_all(&old).unwrap();
            fs::write(old.join(CURRENT), to_toml(&part_named(blake3)).unwrap()).unwrap();
        };
        // An upgrade: the part is known, but its time is only that of the file.
        write_old("aa");
        let known = cache.dated_current(&sku).unwrap().unwrap();
        assert!(known.part == part_named("aa") && !known.is_recorded, "{known:?}");
        cache.make_current(&sku, &part_named("bb")).unwrap();
        let second = cache.dated_current(&sku).unwrap().unwrap();
        assert!(
            second.part == part_named("bb") && second.is_recorded && second.learned_ms > known.learned_ms
        );
        // A version that only reads its own file does not mark on the older part.
        assert_eq!(from_toml::<CurrentPart>(&fs::read(old.join(CURRENT)).unwrap()), Some(part_named("bb")));
        // The rollback, a new part there, and the upgrade again.
        write_old("cc");
        written_after(&old.join(CURRENT), &cache.part_record(&sku));
        let third = cache.dated_current(&sku).unwrap().unwrap();
        assert!(third.part == part_named("cc") && third.learned_ms > second.learned_ms, "{third:?}");
        assert!(!cache.make_current_as_of(&sku, &part_named("bb"), second.learned_ms).unwrap());
        assert!(cache.make_current_as_of(&sku, &part_named("dd"), third.learned_ms).unwrap());
        assert_eq!(cache.current(&sku).unwrap(), Some(part_named("dd")));
        // A part that is dropped again is newer than before.
        let before = cache.current_since_ms(&sku).unwrap();
        cache.make_current(&sku, &part_named("dd")).unwrap();
        assert!(cache.current_since_ms(&sku).unwrap() > before);
        assert!(cache.remove(&sku).unwrap() && cache.current(&sku).unwrap().is_none());
    }

    #[test]
    fn a_surface_of_another_cache_is_taken_in_if_it_is_of_this_part() {
        let [mine, theirs] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let [mine, theirs] = [&mine, &theirs].map(|folder| Cache::new(folder.path()));
        let (sku, key, kept) = ("Saddle".parse::<Sku>().unwrap(), CacheKey::new("00", "top"), kept());
        theirs.keep(&sku, &key, &kept, None).unwrap();
        let bytes = theirs.bytes(&sku, &key).unwrap().unwrap();
        let other = PartOrigin { file: "saddle.obj".into(), blake3: "01".into() };
        assert!(mine.take_in(&sku, &key, &other, &bytes.fit, None).unwrap().is_err());
        assert!(mine.take_in(&sku, &key, &kept.origin, &bytes.fit[1..], None).unwrap().is_err());
        assert!(matches!(mine.get(&sku, &key).unwrap(), Lookup::Miss));
        mine.take_in(&sku, &key, &kept.origin, &bytes.fit, Some(b"no mesh")).unwrap().unwrap();
        assert_eq!(mine.bytes(&sku, &key).unwrap(), Some(bytes));
    }

    #[test]
    fn any_damage_is_detected() {
        let bytes = encode(&kept()).unwrap();
        for cut in [0, 10, HEADER, bytes.len() - 1] {
            assert!(decode(&bytes[..cut]).is_err());
        }
        for at in (0..bytes.len()).step_by(bytes.len() / 97) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(decode(&damaged).is_err(), "byte {at}");
        }
    }
}
