//! The list of codes. `tests/sources/codes.rs` compares it with the sources: every code that the program uses
//! is here, and nothing else.

use super::code::{Code, CodeKind};

const fn reason([code, meaning, explanation, remedy]: [&'static str; 4]) -> Code {
    Code { code, kind: CodeKind::Reason, meaning, explanation, remedy }
}

const fn notice([code, meaning, explanation, remedy]: [&'static str; 4]) -> Code {
    Code { code, kind: CodeKind::Notice, meaning, explanation, remedy }
}

const fn both([code, meaning, explanation, remedy]: [&'static str; 4]) -> Code {
    Code { code, kind: CodeKind::Both, meaning, explanation, remedy }
}

impl Code {
    /// All codes, sorted.
    pub const ALL: &'static [Self] = CODES;
}

const CODES: &[Code] = &[
    notice([
        "align-without-axis",
        "The settings align the drawing to an axis, and the surface has none.",
        "`align = \"axis\"` turns the drawing's x along the direction round the axis of a cylinder or cone. Under this \
         drawing the part was not unrolled as one, because it is another surface or because of `method`. The \
         drawing is placed as with `align = \"view\"`.",
        "Set `align = \"view\"` (`--align view`) for this part, or check the part and `method`.",
    ]),
    reason([
        "archive-changed",
        "The original in the archive differs from the drawing that was delivered.",
        "isomark corrects a delivered drawing again from its original in the archive. Before it does, it compares \
         the original with the hash of the drawing it delivered. Somebody replaced or edited the file in the \
         archive.",
        "Drop the drawing that is to be marked into the hot folder again. Leave the files in the archive \
         unchanged.",
    ]),
    notice([
        "axis-assumed",
        "The file does not state which axis points up, so isomark chose one.",
        "glTF has Y up by its standard, Blender writes OBJ with Y up, FreeCAD with Z up; STL, PLY and lists of \
         points state no axis. The message gives the axis and why it was chosen. If it is a note, the choice is \
         certain; if it is a warning, isomark guessed, and a wrong guess shows the laser another side of the part.",
        "Look at the part in the preview or with `isomark inspect`. If it is on its side, set `up = \"y\"` or `up \
         = \"z\"` under [part], or `--part-up`.",
    ]),
    notice([
        "axis-not-measured",
        "The measurements do not show where the lens axis is.",
        "Distances between crosses, and positions on plates that were put down freely, do not depend on the lens axis. The settings \
         keep it in the middle of the field, or at `axis_mm`.",
        "Hold all plates against the same two stops, measure positions from the same edges, and give `--stops`.",
    ]),
    notice([
        "axis-off-middle",
        "The measured lens axis is far from the middle of the field.",
        "A lens is mounted over the middle of its field. With `--stops` the axis follows from where the same crosses are on plates at \
         different heights, so a plate that was a little off its stops moves the axis much further: about ten times as far with plates \
         30 mm apart under a lens 300 mm away. A wrong axis shifts every mark on a part that is higher or lower than the calibrated \
         plane. The message states the slip that would explain it.",
        "Look at how the head is mounted. If the lens is over the middle of the field, measure again with all plates against the \
         stops, or leave out `--stops`.",
    ]),
    notice([
        "beams-tilted",
        "All beams of a telecentric lens are tilted.",
        "The plates were held against the same stops, and the crosses on the higher plate are all shifted in the same direction: the head \
         is inclined, or that plate was off its stops. Marks on a part that is higher than the calibrated plane are shifted as much for \
         each mm. `kind = \"telecentric\"` does not contain a tilt; a lens table does.",
        "Mount the head upright over the plane and measure again, or write a lens table with `--table`.",
    ]),
    reason([
        "beamserver-answer",
        "BeamServer gave an answer that does not fit the command.",
        "The program at `delivery.address` answered with text that is not an answer to the command, or listed more \
         elements than any project has. Usually another program listens on that port, or the version of \
         BeamConstruct is not supported. The drawing waits and isomark tries again.",
        "Check that `delivery.address` and the port in BeamConstruct's settings agree, and that BeamServer runs \
         there. Then wait, or run `isomark retry STATION.toml`.",
    ]),
    reason([
        "beamserver-busy",
        "BeamServer is busy with another drawing.",
        "Several jobs deliver to one BeamServer, which takes one drawing after the other. This drawing had to \
         wait longer than usual.",
        "Wait: isomark tries again. If it happens often, check whether BeamServer answers slowly.",
    ]),
    reason([
        "beamserver-lost",
        "The imported drawing cannot be identified in BeamConstruct.",
        "After the import exactly one new element must have the drawing's name. isomark found none or more than \
         one, so it cannot verify the size. It does not import again, because that would only add copies.",
        "Remove in BeamConstruct what was imported, then drop the drawing again. If it happens with every \
         drawing, this version of BeamConstruct names imported elements differently: report it, and use `kind = \
         \"folder\"` under [delivery] until then.",
    ]),
    reason([
        "beamserver-path",
        "BeamServer accepts only ASCII paths, and this path has other characters.",
        "The path is made of the import folder (or `delivery.server_folder`) and the drawing's name, and is sent \
         to BeamServer in ASCII.",
        "Name the SKU, the drawing and the folder with the letters a to z, digits, `-` and `_` only.",
    ]),
    reason([
        "beamserver-refused",
        "BeamServer refused a command with an ERROR.",
        "The message contains the command and the two numbers of the error. Usually BeamServer cannot read the \
         file because it knows the import folder under another name, or BeamConstruct shows a dialog. The drawing \
         waits and isomark tries again.",
        "Let BeamServer read the import folder, or set `delivery.server_folder` to its own name for that folder. \
         Look at BeamConstruct for open dialogs.",
    ]),
    reason([
        "beamserver-silent",
        "BeamServer did not answer in time.",
        "The connection was made, but no whole answer arrived within `delivery.answer_s`, or the connection was \
         closed. BeamServer may be starting, marking, or blocked by a dialog; it serves one program at a time. \
         The drawing waits and isomark tries again.",
        "Wait if BeamServer is restarting or busy. Otherwise raise `delivery.answer_s` and close other programs \
         that are connected to BeamServer.",
    ]),
    reason([
        "beamserver-size",
        "BeamConstruct shows the imported drawing at another size than the file has.",
        "isomark compares the width and height in BeamConstruct with those of the corrected drawing. They differ, \
         so the lengths on the part would be wrong. isomark removed the element in BeamConstruct and rejected the \
         drop.",
        "Set BeamConstruct's DXF import to unit mm, without scaling and without fitting to the field. Then drop \
         the drawing again.",
    ]),
    reason([
        "beamserver-unreachable",
        "No connection to BeamServer is possible.",
        "Nothing accepts connections at `delivery.address`: BeamServer is not running, the address or port is \
         wrong, or a firewall blocks it. The drawing waits and isomark tries again.",
        "Start BeamServer, correct `delivery.address`, and allow the port in the firewall.",
    ]),
    notice([
        "build-empty",
        "The 3MF file has no build items.",
        "The build of a 3MF file lists the objects to produce and their places. This one is empty, so isomark reads all \
         objects where they were modelled.",
        "Check the part in the preview. If objects are missing or in the wrong place, export the part again.",
    ]),
    both([
        "cache-damaged",
        "A fitted surface in the cache is damaged and is not used.",
        "Every entry of the cache has a checksum, and this one does not match: the disk failed, or something else \
         changed the file. No drawing is made from it. As a notice, the part was fitted again. As a reason, \
         `correct --sku` had no part to fit, or `cache verify` found the entry.",
        "Run `isomark cache verify --repair` to remove damaged entries. With `correct`, name the part before the \
         drawing. If it happens again, check the disk.",
    ]),
    reason([
        "cache-unusable",
        "The folder of fitted surfaces cannot be read or written.",
        "The cache's disk is full, its share is not connected, or its permissions changed. The drop waits and \
         isomark tries again.",
        "Check that `folders.cache` exists, can be written by the user that runs the station, and has free space.",
    ]),
    notice([
        "clipped-whole",
        "The drawing clips block references to a boundary, and isomark marks them whole.",
        "The DXF file uses XCLIP: the drawing program shows only what is inside the boundary. isomark does not \
         apply clipping, so lines outside it are also marked.",
        "Explode the clipped blocks in the drawing program, trim what must not be marked, and export again.",
    ]),
    reason([
        "code-content",
        "The content of a code cannot be encoded.",
        "The content is empty, longer than the code holds, contains a character that the code lacks, or is not a row of GS1 elements such as `(01)04012345678901(21)17`. The message states which.",
        "Shorten or correct `content` of the code under [content], or choose another `kind`: a Data Matrix and a QR code hold any character.",
    ]),
    notice([
        "code-distorted",
        "Cells of a code change by more than 10 % on the part.",
        "The report states the largest change of a side or diagonal of a cell on the part. On parts that are curved in two directions some change cannot be avoided. Readers decode codes with up to about 10 % of distortion.",
        "Draw a smaller placeholder, place it where the part is flatter, and test the mark with your reader.",
    ]),
    notice([
        "code-finer-than-spot",
        "The cells of a code are finer than the laser's spot.",
        "A cell is narrower than `spot_mm` under [optics], so neighbouring cells run together and the code cannot be read.",
        "Draw a larger placeholder, or shorten the content of the code.",
    ]),
    notice([
        "code-layer-missing",
        "The drawing has no placeholder for a code of the settings.",
        "`codes` under [content] names a layer, and the drawing has nothing on it. The drawing is marked without this code.",
        "Draw a closed rectangle on this layer, or remove the code from the settings.",
    ]),
    notice([
        "code-outlines",
        "A code is marked as the outlines of its cells.",
        "The outlines of inked cells are contours. A reader needs them filled.",
        "Give `spacing_mm` under [fill] (`--fill 0.05`), or hatch the contours in the marking software.",
    ]),
    notice([
        "code-page-unknown",
        "The drawing names a code page that isomark does not know.",
        "DXF files older than R2007 store texts and layer names in a code page. isomark reads letters beyond \
         ASCII as UTF-8 or Windows-1252, so accents and other scripts may be wrong. Lines and curves are not \
         affected.",
        "Export the drawing as DXF R2007 or newer. If texts are marked, check them in the preview.",
    ]),
    reason([
        "code-placeholder",
        "A path on the layer of a code is not a closed rectangle.",
        "The layers that `codes` under [content] names are for placeholders: closed rectangles in any direction, each of which is replaced by a code. Anything else on these layers would be lost or marked over the code.",
        "Draw one closed rectangle for each code on this layer, and everything else on other layers.",
    ]),
    reason([
        "code-too-many",
        "The codes of the drawing have too many modules.",
        "All codes of a drawing together have at most 2,000,000 modules.",
        "Draw fewer placeholders, or shorten the content of the codes.",
    ]),
    notice([
        "colours-replaced",
        "True colours were replaced by the nearest colours of the table.",
        "The output format R12 (`output.dxf`) has only the 255 numbered AutoCAD colours. Two colours of the \
         drawing may have become the same, and the marking software may then assign the same parameters to both.",
        "Use `dxf = \"R2000\"` under [output] if the marking software reads it, or use numbered colours in the \
         drawing.",
    ]),
    reason([
        "companion-missing",
        "The part needs a file that is not in the hot folder.",
        "A `.gltf` file stores its geometry in `.bin` files beside it. Without them the part cannot be read. The \
         part waits for `watch.incomplete_s` and is then rejected.",
        "Drop the named file beside the part, or export the part as `.glb`, which is one file.",
    ]),
    reason([
        "companion-short",
        "A file that the part needs is not complete.",
        "The `.bin` file beside a `.gltf` is shorter than the part states, or is still being written. The part \
         waits for `watch.incomplete_s` and is then rejected.",
        "Copy the named file again, or export the part as `.glb`, which is one file.",
    ]),
    reason([
        "content-missing",
        "A field of the drawing has no value.",
        "The drawing contains a field such as `{serial:06}`, `{date}`, `{shift}` or `{csv:LOT}`, and there is no value for it, or the value does not fit its format. The message names the field, its text, layer and handle.",
        "Give the value with `--content`, `--date` or a list. To mark the text of the field itself, double its braces: `{{serial}}`.",
    ]),
    notice([
        "content-unused",
        "Values are given, and the drawing marks none of them.",
        "A serial number, or values of columns (`--content`, `--list`, or [content] in the settings), are given for a drawing whose texts \
         and codes have neither the field `{serial}` nor `{csv:COLUMN}`. All drawings of a list would be the same.",
        "Write the field into a text of the drawing or into the content of a code, exactly as the README names it, or leave out the \
         values.",
    ]),
    notice([
        "contours-closed",
        "Nearly closed outlines were closed.",
        "The ends of an outline were closer together than `joining_mm` under [pattern]. The report lists the \
         places and the widest gap. Closed contours can be filled by the marking software.",
        "Nothing to do if the gaps are rounding. Set a smaller `joining_mm`, or `strict = true`, to keep the gaps.",
    ]),
    notice([
        "copies-removed",
        "Duplicate paths were removed; one copy of each is marked.",
        "A line that is in the drawing twice would be marked twice, deeper and darker. The report lists the \
         places.",
        "Nothing to do if the duplicates are mistakes. Set `strict = true` under [pattern] (`--strict`) to mark them \
         twice on purpose.",
    ]),
    reason([
        "correction-overtaken",
        "Something changed while isomark corrected this drawing again.",
        "A new part of the SKU arrived, or the original in the archive changed, during a correction that `isomark \
         retry` asked for. The result was discarded.",
        "Wait: isomark tries again. With `watch --once`, run `isomark retry STATION.toml` again.",
    ]),
    notice([
        "cracks-joined",
        "Triangles of the mesh that do not quite meet were joined.",
        "Programs that cut each face into triangles by itself leave cracks of some thousandths of a millimetre. Corners that are \
         at most 0.005 mm apart are moved to the middle between them, unless a triangle there has a side below 0.02 mm. The message \
         gives the number of sides, and the place of the widest crack.",
        "Nothing to do if the part looks right. To get rid of the note, merge the vertices by distance before the export.",
    ]),
    reason([
        "cut-short",
        "The file ends too early.",
        "The file did not change for `watch.incomplete_s`, or for 3 s after its writer closed it, and is still not \
         complete: the copy or the export was interrupted.",
        "Export or copy the file again. Copy under a name that ends in `.tmp` and rename the file when it is \
         complete.",
    ]),
    notice([
        "dashed-whole",
        "Dashed or dotted lines are marked as solid lines.",
        "The drawing assigns a line type with gaps to these lines. A line type is only a way of display in DXF: \
         the file contains the whole line, and the laser marks it whole.",
        "Explode the line type in the drawing program (for example with FLATTEN or EXPLODE of the express tools) \
         if the gaps must be marked.",
    ]),
    notice([
        "distance-changes",
        "The distance between two marks differs between part and drawing.",
        "On a part that is curved in two directions, no map keeps everything. isomark keeps the lengths of lines and the sizes and \
         shapes of areas, and the empty space between them gives way: gaps, and distances from letter to letter or from dot to \
         dot. `quality.distances` in the report has the mean and the largest change.",
        "Where distances matter as much as lines, set `weighting = \"uniform\"` under [correction] (`--weighting uniform`). \
         Otherwise nothing.",
    ]),
    notice([
        "drawing-askew",
        "The drawing is slightly askew on a cylinder or cone.",
        "On a tilted cylinder or cone, or beside its crest, a direction that is horizontal in the laser's view is not \
         the direction round the axis. Text placed like that climbs round the part by the angle in the message, from \
         0.5 to 45 deg. The report gives the angle in `placement.round`. With a marking frame this is a note, because \
         the frame gives the direction.",
        "Set `align = \"axis\"` under [placement] (`--align axis`), or turn the drawing (`rotate_deg`) or the marking \
         frame. If the drawing is to be like this, nothing needs to be done.",
    ]),
    reason([
        "drawings-uncertain",
        "It is not known whether some drawings were delivered.",
        "The station stopped while it delivered a drawing, and the drawing is not in the import folder now. \
         Either the marking software has taken it, or it never arrived. `watch --once` reports this with exit \
         code 3.",
        "Run `isomark status STATION.toml` to see which drawings these are, and check in the marking software. If \
         they did not arrive, run `isomark retry STATION.toml --uncertain`.",
    ]),
    notice([
        "drawn-twice",
        "Paths are in the drawing twice and will be marked twice.",
        "The drawing was read strictly, so the copies stay. Lines that are marked twice get deeper and darker.",
        "Remove the copies in the drawing program, or leave out `strict` to let isomark remove them.",
    ]),
    reason([
        "drops-rejected",
        "`watch --once` rejected at least one drop.",
        "The station has processed everything in the hot folder, and some files were rejected. Their reasons are \
         in the rejected folder.",
        "Read the `.reason.txt` beside each file in the rejected folder, correct the file and drop it again.",
    ]),
    notice([
        "empty-pieces-removed",
        "Pieces without length were removed.",
        "Lines from a point to the same point mark nothing, but can make a laser fire at one spot. Points (POINT \
         entities) are kept. The report lists the places.",
        "Nothing to do. Draw spots that are to be marked as points.",
    ]),
    reason([
        "ends-isomark",
        "isomark crashed each time it processed this file.",
        "The process ended several times during this job without a message. The usual cause is a lack of memory: \
         the system ends the process. The file was rejected to keep the station running.",
        "Export the file with fewer triangles or lines, or give the computer more memory. If the file is small, \
         it is a defect in isomark: keep the file and report it.",
    ]),
    notice([
        "ends-not-joined",
        "Ends of lines were not joined because more than two meet at one point.",
        "Loose pieces are joined to contours where exactly two ends meet. At a branch it is not clear which two \
         belong together, so all ends stay loose. Everything is still marked.",
        "Nothing to do, unless a filled contour is missing. Then join the pieces in the drawing program.",
    ]),
    reason([
        "environment",
        "A file or folder cannot be read or written.",
        "The operating system reported an error: the file does not exist, permissions are missing, the disk is \
         full, or a share is not connected. The input itself may be valid. The exit code is 3; trying again later \
         may help.",
        "Check that the named file or folder exists, that you may read or write it, and that the disk has free \
         space.",
    ]),
    notice([
        "extension-ignored",
        "The file requires extensions that change only its look.",
        "A glTF file lists the extensions that a program must know. Those named in the message change materials, lights, \
         motion or descriptions, not the shape, so isomark ignores them.",
        "Nothing to do.",
    ]),
    notice([
        "extra-point",
        "Polylines begin with a point at (0, 0) that their point count does not include.",
        "Old FreeCAD exporters write this extra point. The drawing was read strictly, so the point stays and a \
         line from the origin is marked.",
        "Leave out `strict` to let isomark remove the point, or export with a newer FreeCAD.",
    ]),
    notice([
        "extra-point-removed",
        "A superfluous first point at (0, 0) was removed from polylines.",
        "Old FreeCAD exporters write a first point that the polyline's own point count does not include. With it, \
         a line from the origin would be marked. The report lists the polylines.",
        "Check in the preview that the outlines are right.",
    ]),
    notice([
        "facet-count-zero",
        "The STL file states that it has no facets, but has some.",
        "Some programs write the number of facets into the header last, and do not come to it. The size of the file is exactly that of \
         a header and whole facets, so all of them were read.",
        "Check in the preview that the part is complete, or export it again.",
    ]),
    notice([
        "facets-coarse",
        "The part's facets, or the points of a scan, leave its surface uncertain under the drawing.",
        "The vertices of a mesh are on the part; between them isomark continues the surface smoothly. Where neighbouring \
         facets lead to different slopes, the true surface is not known exactly. The same holds where the normals in the file lean \
         from those of a smooth surface, or the vertices scatter; the warning names which of these it is. The faces of a STEP file are exact, but \
         isomark takes samples of them, which round a sharp bend. The reported errors of lengths, areas \
         and angles contain this uncertainty (`uncertain` in the report), and here it is most of the length error.",
        "Export the part from CAD as STEP, which contains the exact surfaces, or as glTF, which contains their normals; other meshes with \
         finer facets. In Blender, apply the Subdivision modifier; where the normals lean, use Mesh > Normals > Reset Vectors, or set \
         `normals = \"estimate\"`. A scan needs less noise or more points. On a STEP file place the drawing away from the bend.",
    ]),
    notice([
        "facets-flat",
        "It is not known whether facets that are shaded flat are those of a round face.",
        "The file's normals make some facets flat and others of the same body smooth, as shading by an angle does. The flat ones \
         turn on and on by about the same angle, as those of a round face do. They are marked as flat; the reported errors \
         contain the difference. `correct` gives the warning only if the surface under the drawing is uncertain.",
        "If the facets are flat, set `normals = \"file\"` under [part] (`--normals file`). If they are round, shade them smooth \
         and export the part again.",
    ]),
    notice([
        "facets-rounded",
        "It is not known whether the part is round or its facets are flat; a smooth surface was taken.",
        "Facets that turn on and on by about the same angle are those of a round part, or of one that is meant to be angular. A \
         file without normals, or with flat shading, does not tell which. isomark takes the smooth surface through their \
         vertices, and the reported errors are those on it. The number is how far it is above the middle of the facets. \
         The warning is given where facets leave the surface further, or turn more, than CAD programs let them when they cut a \
         round face. `correct` gives it only if the surface under the drawing is not a plane.",
        "If the facets are meant as they are, set `normals = \"facets\"` under [part] (`--normals facets`), or `file` if the file \
         has smooth shapes, too. If the part is round, export it from CAD as STEP or GLB, with smooth shading, or with finer facets; \
         `normals = \"estimate\"` confirms that it is round.",
    ]),
    notice([
        "field-misspelt",
        "A text in braces is almost a field, and is marked as it is.",
        "Only `{serial}`, `{date}`, `{shift}`, `{csv:COLUMN}` and `{sku}` are fields, with these small letters and without blanks. Other \
         braces are texts like all others.",
        "If a value is meant, write the field as the message names it.",
    ]),
    notice([
        "field-off-center",
        "The middle of a mark with fields is not at the stated place.",
        "All products are placed by the same point, so that what is the same on all of them has the same place. That is the middle \
         of the drawing with the usual number of digits in dates and padded serial numbers, and with all other fields as they are \
         written in the drawing.",
        "Align texts with fields in the middle, or place the drawing by its origin (`--anchor origin`, `anchor = \"origin\"` under \
         [placement]).",
    ]),
    both([
        "field-scale",
        "The marking software's own scale is not true.",
        "On the calibrated plane, crosses are marked farther apart or nearer than they are drawn. With lens \
         distances, isomark does not correct this: it is the calibration of the marking software. The lens distances are found in \
         spite of it. A lens table (`--table`) contains the scale as it was measured, and isomark compensates for it. A scale that is off \
         by more than 20 %, or that a drawing with another number of crosses explains, is refused.",
        "With lens distances, correct the scale in the marking software, with its own calibration. With a lens table, leave it as it is, \
         or mark and measure again after the correction. Check the ruler.",
    ]),
    reason([
        "file-held-open",
        "Another program has a file of the station open.",
        "The station writes drawings, reports and originals under names that may exist already. A program that has such a file open, \
         such as the marking software or a viewer, does not let it be replaced.",
        "Close the program that has the file open. The job then continues by itself.",
    ]),
    reason([
        "file-too-large",
        "The file is larger than a hot folder accepts.",
        "The limit protects the station's memory. The number in the reason is the size of the file or of a file \
         that it needs.",
        "Export the part with fewer triangles, or the drawing with fewer points.",
    ]),
    reason([
        "file-unreadable",
        "The file in the hot folder cannot be read.",
        "Another program keeps the file open without sharing it, or the user that runs the station has no \
         permission to read it. The drop waits and isomark tries again.",
        "Close the program that uses the file, or give the station's user permission to read it. isomark then \
         reads it without further action.",
    ]),
    reason([
        "file-unsteady",
        "The file changed while isomark read it.",
        "A program is still writing the file. The drop waits and is read again when it no longer changes.",
        "Nothing. If it happens often, write the file under a name that ends in `.tmp` and rename it when it is \
         complete.",
    ]),
    notice([
        "fill-crossing",
        "A contour that is to be filled crosses itself.",
        "By the even-odd rule, what such a contour encloses once is filled and what it encloses twice \
         is not. The message states how many contours cross themselves and where the first one does.",
        "Look at the fill in the preview. If a part is missing, unite the pieces of the outline in \
         the drawing program.",
    ]),
    reason([
        "fill-cut",
        "Filled contours would be cut between tiles.",
        "A mark round the part is divided into tiles. Where a contour is wider than a tile, it is cut into open lines, which bound no area that could be filled.",
        "Leave gaps between the contours, let tiles be wider (`max_tile_deg` under [rotary], `incidence_warn_deg` under [optics]), or fill only other layers (`layers` under [fill]).",
    ]),
    reason([
        "fill-finer-than-spot",
        "The lines of a fill are closer together than the spot is wide.",
        "Each line of the fill is as wide as `spot_mm` under [optics]. Lines that are closer together overlap: the area is marked several times, deeper and darker.",
        "Give `spacing_mm` under [fill] at least the width of the spot. If the lines are to overlap, remove `spot_mm`.",
    ]),
    notice([
        "fill-in-outline",
        "Letters or hatches are inside an outline that is filled, and stay unfilled.",
        "A fill fills all closed contours of its layers. If letters inside a filled frame were filled too, nobody would see them: \
         so they stay unfilled, and the frame round them is filled.",
        "To fill the letters and mark the frame as a line, put the frame on another layer and name the layers to fill \
         (`layers` under [fill]). To fill the frame, do nothing.",
    ]),
    notice([
        "fill-layer-missing",
        "The drawing has no layer with the name of a layer to fill.",
        "`layers` under [fill] names a layer that the drawing does not have, perhaps because of a \
         typing error. Nothing is filled for it.",
        "Correct the name in `layers`, or remove it.",
    ]),
    reason([
        "fill-not-found",
        "The equations for evenly spaced fill lines could not be solved.",
        "isomark finds the lines of a fill as the level lines of a distance on the part. The \
         equations for it had no solution, or memory was not enough.",
        "Fill fewer layers (`layers` under [fill]), or check the drawing's size.",
    ]),
    notice([
        "fill-nothing",
        "A fill is set, and nothing was filled.",
        "The drawing has no closed contour and no solid hatch on the layers of the fill, or they are \
         narrower than the distance of the lines and the border.",
        "Close the contours in the drawing, name their layers in `layers` under [fill], or lower \
         `spacing_mm` and `border_mm`. `spacing_mm = 0` fills nothing.",
    ]),
    notice([
        "fill-open",
        "Lines on the layers of the fill are open, so they enclose nothing.",
        "Only closed contours are filled. As a note the lines are probably meant to be open; as a \
         warning the ends of some are at most 1 mm apart, so they are probably meant to be closed.",
        "Close them in the drawing program, or raise `joining_mm` under [pattern] to the gap in the \
         message.",
    ]),
    reason([
        "fill-too-much",
        "The fill has more lines than can be marked.",
        "The length of all lines is about the filled area divided by their distance. isomark stops at \
         5,000,000 mm, more than an hour of marking, and at 3,000,000 points or pieces of lines.",
        "Raise `spacing_mm` under [fill] (`--fill`), or fill fewer layers (`layers`).",
    ]),
    notice([
        "fill-uneven",
        "The lines of the fill are not evenly spaced everywhere on the part.",
        "On more than 1 % of the fill, the distance of neighbouring lines on the part differs from \
         `spacing_mm` by more than 1 %. Lines at the same distance exist on every surface, but where \
         it is strongly curved they would meet or part.",
        "Look at the place that the report shows. Another direction (`angle_deg`), a smaller drawing, \
         or a place where the part is less curved helps.",
    ]),
    notice([
        "fills-not-shown",
        "Fills are marked that the drawing does not show.",
        "`$FILLMODE` is 0 in the DXF file. AutoCAD then shows no hatches, and only the outlines of solids and wide polylines. isomark marks \
         them as in any other drawing.",
        "Delete the fills that must not be marked. Otherwise set `FILLMODE` to 1 in the drawing program, and save the drawing again.",
    ]),
    notice([
        "fills-outlined",
        "Filled areas are written as outlines.",
        "HATCH and SOLID entities become closed contours. The corrected drawing contains no lines that fill them, because \
         `spacing_mm` under [fill] is not set.",
        "To fill them evenly on the part, set `spacing_mm` under [fill] (`--fill 0.05`). Otherwise hatch them in the marking software.",
    ]),
    notice([
        "finer-than-spot",
        "Lines are closer together than the spot is wide.",
        "The marked line is as wide as `spot_mm` under [optics]. Lines that are drawn closer together than that merge into one, which is marked with more energy.",
        "Draw the lines farther apart, or as one line. Correct `spot_mm` if the laser marks finer lines.",
    ]),
    notice([
        "flat-side",
        "The laser looks at a flat side of the part, and a curved side is probably meant.",
        "Without another setting the laser looks at the top of the part, +z. Here that side is flat, such as the lid of \
         a can, and the part has curved sides with more surface that can be marked. The notice appears only if the \
         side was not given for this part.",
        "Name the side with `facing` (`--facing`) in the file of the SKU or on the command line; `isomark inspect PART` \
         lists the sides and where a drawing fits. If the flat side is meant, name it in the same way.",
    ]),
    reason([
        "fleet-answer",
        "The fleet's database gave an error that trying again does not resolve.",
        "The server refused a statement or a value. The message contains its text. The tables may have been changed by hand, or the server \
         is of an untested version.",
        "Run `isomark fleet check` and look at the log of the server. Stations work without the fleet.",
    ]),
    reason([
        "fleet-away",
        "The fleet's database does not answer.",
        "The server is stopped, restarts or is full, or the network does not reach it. A station reports this once, works alone with what \
         it knows, and reconnects automatically.",
        "Check that the server runs and has free disk space, and that this computer reaches it. No action is needed at the stations.",
    ]),
    reason([
        "fleet-certificate",
        "The certificates for the connection to the fleet cannot be read.",
        "`certificate` under [fleet], or `--certificate`, names a file with the certificates of the authority that signed the \
         server's, as PEM. The file is missing, contains no certificate, or is damaged.",
        "Give the certificate of the authority as a PEM file, or remove the setting if the system trusts the authority.",
    ]),
    reason([
        "fleet-check",
        "`isomark fleet check` found something wrong.",
        "Each line of its output is one check; those that begin with `wrong` contain a remedy.",
        "Follow the remedies in the lines that begin with `wrong`, and check again.",
    ]),
    reason([
        "fleet-fit-unknown",
        "The fleet has no fit with this key.",
        "`--fit` of `isomark fleet prune` names a fitted surface by its key of 32 digits. The key is mistyped, or the fit was removed before.",
        "Copy the key from the log of the station that names it.",
    ]),
    reason([
        "fleet-newer",
        "The tables of the fleet are newer than this program, or were made by another one.",
        "Another computer with a newer isomark upgraded the tables. This program does not write into tables that it does not know. A \
         station works alone until it is updated.",
        "Update isomark on this computer.",
    ]),
    reason([
        "fleet-older",
        "The tables of the fleet are missing or too old.",
        "A new version of isomark may need new tables. Only the owner of the database makes them.",
        "Run `isomark fleet init URL` as the owner of the database; stations reconnect automatically.",
    ]),
    reason([
        "fleet-outbox",
        "The messages of the station to its fleet cannot be read.",
        "What a station has to send waits in `fleet/outbox` in its state folder. The folder cannot be read or written. Parts that are \
         dropped wait until it can.",
        "Check the rights of the state folder and the free space on its disk. The station retries automatically.",
    ]),
    reason([
        "fleet-password",
        "The password for the fleet cannot be read.",
        "It is on the first line of the file that `password_file` under [fleet] names, or in the environment variable that \
         `password_variable` names.",
        "Write the password there, readable for the user that runs isomark. A station retries automatically.",
    ]),
    reason([
        "fleet-refused",
        "The fleet's database refuses the connection.",
        "User or password are wrong, pg_hba.conf does not permit the login, the database does not exist, or the server is not the one that \
         its certificate names. Connections to other computers are encrypted and verified.",
        "Do what the message says: it names the cause. Only for a server that offers no TLS, on a trusted network, put \
         `?sslmode=disable` at the end of the URL.",
    ]),
    reason([
        "fleet-release-too-large",
        "The settings are too large to be released.",
        "`isomark fleet release` accepts settings of a SKU of at most 1 MiB and 5000 lines. Every station keeps them and compares each \
         version with the one before.",
        "Remove what is not needed. The file contains only the settings that differ from those of the station.",
    ]),
    reason([
        "fleet-rights",
        "The login may not do this in the fleet's database.",
        "Each login needs one of the roles isomark_station, isomark_worker, isomark_office or isomark_viewer. A station's name belongs to \
         the login that first used it.",
        "Run the `GRANT` that the message names, as the owner of the database, with the name of the login; or give the station \
         another `name` under [fleet].",
    ]),
    reason([
        "fleet-station-in-use",
        "A station that is to be removed from the fleet is still in use.",
        "`isomark fleet prune --station` removes a station that no longer exists. This one is alive, or it has taken jobs whose end it has not \
         reported: they may have been marked.",
        "End the station, look at its laser, put its jobs back into their queues with `isomark retry --take-over`, and try again.",
    ]),
    reason([
        "fleet-station-unknown",
        "No station of the fleet has this name.",
        "`--station` of `isomark fleet release` and `isomark fleet prune` names a station as `isomark fleet status` lists it: by `name` \
         under [fleet], or by the name under [station]. Settings for any other name would not reach a station.",
        "Correct the name. A new station is known after its first start.",
    ]),
    reason([
        "fleet-url",
        "The address of the fleet cannot be used.",
        "It has the form `postgresql://user@host:port/database`, with `?sslmode=disable` or other parameters of PostgreSQL. It never \
         contains a password, because settings are logged.",
        "Correct the URL; give the password in a file or an environment variable.",
    ]),
    notice([
        "focus-opens-contours",
        "Contours are cut between steps of focus and become open lines.",
        "With `steps = \"layers\"` under [focus], the drawing is cut where the height on the part is that of the border between two \
         steps. A contour that is cut has ends, and marking software fills only closed contours.",
        "To fill such contours, set `spacing_mm` under [fill] (`--fill`): the lines of the fill are cut, too. For outlines, do \
         nothing.",
    ]),
    reason([
        "focus-too-many-steps",
        "The drawing would be cut into too many steps of focus.",
        "The height of the drawing divided by `step_mm` under [focus] (or `focus_depth_mm` under \
         [optics]) is more than 200.",
        "Raise `step_mm` under [focus].",
    ]),
    reason([
        "folder-missing",
        "A folder of the station cannot be created.",
        "isomark creates the folders of a station at the start, except the import folder. Creating this one \
         failed.",
        "Create the folder yourself, or change the named key under [folders] in the station's file.",
    ]),
    reason([
        "folder-trouble",
        "A folder of the station cannot be used.",
        "The folder is full, read-only, not connected, or the permissions changed. The drop waits and isomark \
         tries again.",
        "Check that the folder exists, can be written by the user that runs the station, and has free space. The \
         job then continues without further action.",
    ]),
    reason([
        "folder-unreadable",
        "The hot folder cannot be listed.",
        "`isomark check` tried to list the folder as the current user and failed.",
        "Let the user that runs the station read the folder, or name another one under [folders].",
    ]),
    reason([
        "folder-unwritable",
        "A folder of the station cannot be written.",
        "`isomark check` tried to create a file there as the current user and failed. The station may run as \
         another user.",
        "Let the user that runs the station write into the folder, or name another one under [folders].",
    ]),
    notice([
        "font-replaced",
        "Texts are drawn in another font than the drawing asks for.",
        "isomark has no fonts of the system, only its own. The letters have other shapes and widths, so the text \
         may be longer or shorter than in the drawing program.",
        "Convert texts to outlines in the drawing program if their appearance matters.",
    ]),
    reason([
        "foreign-file",
        "The result would replace a file in the import folder that is not from isomark.",
        "This station has delivered no drawing of this name, and the file does not have the comments of a corrected drawing at its \
         beginning. Somebody else put it there, and there may be no copy of it. With `comments = false` results cannot be \
         recognised, and are replaced as before.",
        "Move the file out of the import folder, or rename the drawing. Then drop the drawing again.",
    ]),
    notice([
        "frame-above",
        "The marking frame is far above the surface that the laser sees.",
        "The origin of the frame is where the drawing is placed. From there it is moved along the frame's z axis onto \
         the surface, however far that is.",
        "Check that the drawing lands where you meant it, in the picture of the result (`--preview`, `--report-html`), \
         or move the frame's origin onto the surface.",
    ]),
    notice([
        "frame-ambiguous",
        "Several nodes of the part's file are named `isomark`, and the first one is the marking frame.",
        "A glTF part states with a node (an empty) of this name where and how it is marked. With several of them \
         isomark uses the first one of the scene; the message gives its place.",
        "Keep one node `isomark` in the file, or give the frame with `--frame` or `frame` under [part].",
    ]),
    notice([
        "frame-chosen",
        "The part's file has a marking frame, and the settings give another view or place.",
        "A node `isomark` in a glTF part gives the side that faces the laser, and where the drawing is placed. It \
         replaces the station's `facing`, `roll_deg` and `place_mm`, which are for every part. What is given for \
         this part, in the file of its SKU or on the command line, replaces the node: `facing`, `roll_deg` or \
         `frame`. The message states which of them is used. It is a warning where `roll_deg` is given without `facing`: a \
         roll turns the part about the laser's axis, and names no side.",
        "If the other one is to be used, remove the one that is not needed: the node from the part's file, or the \
         settings of the SKU or the command line.",
    ]),
    notice([
        "frame-inside",
        "The marking frame is below the surface that the laser sees.",
        "The origin of the frame is where the drawing is placed. From there it is moved along the frame's z axis onto \
         the surface, however far that is.",
        "Check that the drawing lands where you meant it, in the picture of the result (`--preview`, `--report-html`), \
         or move the frame's origin onto the surface.",
    ]),
    reason([
        "frame-into-part",
        "The marking frame's z axis points into the part.",
        "The origin of the frame is on the surface, and its z axis points to the laser, so it must point out of the \
         part. As it points into the part, the laser would see the opposite side and the mark would be upside down \
         there.",
        "Turn the frame by half a turn about its x axis, until its z axis points out of the part.",
    ]),
    reason([
        "frame-mirrored",
        "The marking frame in the part's file is mirrored.",
        "The node `isomark`, or an object that it belongs to, has a negative scale. It turns some axes of the frame \
         round, so isomark cannot know which way the drawing is meant.",
        "Give the empty and its parents a positive scale in the modelling program (Blender: Object, Apply, Scale) and \
         export again.",
    ]),
    reason([
        "frame-without-axes",
        "The marking frame in the part's file has no directions.",
        "The node `isomark` has a scale of zero, or a transform that flattens it, so the direction to the laser and \
         the direction of the drawing's x are unknown.",
        "Give the empty `isomark` a scale of 1 in the modelling program and export again.",
    ]),
    notice([
        "glb-trailing-bytes",
        "The GLB file has bytes after its end.",
        "The header of the file states a smaller length than the file has. The part itself is complete; the rest \
         was ignored.",
        "Nothing to do if the part looks right. Export it again if the file was edited or joined by another tool.",
    ]),
    notice([
        "gltf-repaired",
        "The glTF file is not valid, and was read without what is wrong.",
        "The message lists what was repaired or ignored: scenes without nodes, and invalid animations, materials, textures, \
         images and cameras, and skins that no object uses. None of them changes the shape.",
        "Check the part in the preview. Update the program that wrote the file.",
    ]),
    notice([
        "gradients-whole",
        "Hatches with a gradient are marked completely.",
        "isomark marks the whole area of a gradient hatch in a DXF file. It does not convert shades to dots (halftone).",
        "Check that the whole area may be marked, or draw the parts that must be marked.",
    ]),
    notice([
        "hairlines-centred",
        "Lines that are narrower than the beam are marked without their width.",
        "The edges of such a line are closer together than the beam is wide, so marking both would mark the same line twice. \
         isomark marks the centre line once. The message gives the number, the width below which this is done, and the \
         first of the lines.",
        "Nothing to do. To mark the widths, set a smaller `hairline_mm` under [pattern] (`--hairline`).",
    ]),
    notice([
        "height-assumed",
        "The points do not show the height of the part, and no height was given.",
        "Under a lens that is not telecentric, the points of the field that hit a part depend on its height. `isomark register` finds the \
         height together with the pose if the points show it, as points far apart do. Two edges of the part do not: a higher part whose \
         edges are a little shifted is hit in the same places. isomark then assumes a height near `z_mm` under [fixture]. The \
         uncertainties of x and y contain that it can be wrong by 20 mm (one standard deviation), and `--write` enters nothing.",
        "Measure the height of the part's origin above the calibrated plane and give it with `--z`; or measure points that are far apart, \
         or a third edge opposite to one of the two.",
    ]),
    notice([
        "hole-bridged",
        "Small holes in the mesh, where triangles are missing, were bridged.",
        "Exporters and repair tools sometimes lose a triangle. isomark continues the surface across a hole of at most \
         a few sides and at most the width of `bridge_mm` (by default one or two missing triangles, up to 2 mm). \
         The message gives the widest hole and its place. If the side that faces the laser has more than three \
         such holes, they are treated as part of the design and stay open.",
        "Check that the place is not a real hole. `bridge_mm = 0` under [part] (`--bridge 0`) leaves all holes open.",
    ]),
    reason([
        "hot-folder-held",
        "Another station takes drops from the same hot folder.",
        "Two stations that share a hot folder would take files from each other. This station stops.",
        "Stop the other station, or give each station its own `hot` and `state` folders.",
    ]),
    reason([
        "import-is-file",
        "The import folder is a file.",
        "`folders.import` must name the folder that the marking software imports from.",
        "Correct `folders.import` in the station's file.",
    ]),
    reason([
        "import-missing",
        "The import folder does not exist.",
        "`watch` never creates the import folder, because a folder that is not connected must not be replaced by \
         an empty one. Drawings wait until the folder is available.",
        "Create the folder, or connect its share. No further action is needed.",
    ]),
    reason([
        "import-other",
        "The import folder is another one than when the delivery was interrupted.",
        "The station stopped while it delivered this drawing. Now the path of the import folder leads to another \
         folder or another share, so isomark cannot find out whether the drawing arrived.",
        "Connect the share with the former import folder. Or check there whether the drawing arrived, and drop it \
         again if it did not.",
    ]),
    notice([
        "inclined",
        "The beam hits the part at a noticeable angle.",
        "Under the ink the surface is inclined to the beam by more than `incidence_note_deg` under [optics]. \
         Marks get slightly wider and paler there.",
        "Nothing to do. Place the drawing where the part faces the laser if the mark must look even.",
    ]),
    reason([
        "ink-hidden",
        "Another part of the body is between the lens and the ink.",
        "Through a perspective lens the beam is oblique away from the lens axis. The beam to some of the ink would meet another part of the body first, such as a step or a rim, and mark that. The number is how far the part rises above the beam.",
        "Move the drawing away from the step, move the part towards the lens axis, or turn the part. `shadow_mm` under [optics] is the limit.",
    ]),
    notice([
        "ink-layer-missing",
        "The settings name an ink layer that the drawing does not have.",
        "`ink_layers` under [pattern] selects the layers whose lengths are kept. A layer with this name is not in \
         the drawing; often the name is misspelt or the drawing uses another template.",
        "Compare `ink_layers` with the layers in the message, and correct one of them.",
    ]),
    both([
        "ink-lost",
        "The drawing shows ink that cannot be marked.",
        "Visible entities on ink layers are of a kind that cannot be converted to lines, such as letters that no \
         font has, pictures or 3D solids. A mark without them would be incomplete. As a reason, the drawing is \
         rejected. As a notice, `isomark inspect` reports that a job would reject it.",
        "Convert the listed entities to curves in the drawing program, or hide their layer. To mark the drawing \
         without them, set `losses = \"warn\"` under [pattern] (`--losses warn`).",
    ]),
    reason([
        "internal-error",
        "A defect in isomark stopped this job.",
        "The program detected a state that must not occur and ended this job. The station continues with the \
         other drops.",
        "Keep the file and report it together with the message.",
    ]),
    reason([
        "job-being-checked",
        "A job from the fleet waits until the fleet confirms that it still belongs to this station.",
        "The station took the job, and then it was started again, or had no answer from the fleet for 30 s. Meanwhile a person may have given the job to another station, so it waits until the fleet confirms that it is still this station's. Other drops go on.",
        "No action is needed: it continues when the fleet answers. `isomark status` shows what is wrong with the fleet. If the database is lost for good, remove [fleet] from the settings of the station: it then continues with the job.",
    ]),
    reason([
        "job-name",
        "Only drawings can be sent to another line.",
        "Each needs a plain name such as can@date.dxf. Their settings and lists are sent with them; parts are known at all stations of a fleet.",
        "Give the drawing, .dxf, .svg, .png or .bmp.",
    ]),
    reason([
        "job-taken-over",
        "A job from the fleet was taken away from this station.",
        "The station had taken the job and was silent. A person put it back into the queue of its line with `isomark retry --take-over`, so this station no longer does it.",
        "No action is needed if the drawing is marked elsewhere; `isomark fleet status` shows where the job is. If no other station marks \
         it, `isomark retry station.toml NAME --force` puts it back into the hot folder.",
    ]),
    reason([
        "job-too-large",
        "A drawing with its settings and its list is too large for another line.",
        "A job sent through the fleet can be at most 64 MiB.",
        "Simplify the drawing, split its list, or drop it at its line.",
    ]),
    notice([
        "last-line-open",
        "The last line of the file has no line break.",
        "Text formats such as OBJ and lists of points have no end mark. A file that was cut inside its last line \
         can look like this, and then its last entry is wrong.",
        "Compare the file's size with the original. Nothing to do if the program always writes the file this way.",
    ]),
    notice([
        "layers-renamed",
        "Layers have other names in the corrected drawing.",
        "The output format cannot store these names: R12 allows only short plain names. The message lists the old \
         and the new names.",
        "Assign the parameters of the marking software to the new names, or use `dxf = \"R2000\"` under [output].",
    ]),
    notice([
        "lengths-alone",
        "The map keeps hardly anything but the lengths of lines.",
        "With the aim `lengths`, the map also keeps shapes, areas and distances a little. Here the lines would be less true with \
         that than in the drawing as it is, as with rings round the top of a ball. So these weights were lowered until the \
         lines are as true as in the drawing as it is, or truer.",
        "Nothing, if lengths matter most. Where shapes and areas matter too, use the aim `balanced`.",
    ]),
    notice([
        "lengths-traded",
        "The correction makes the lines less true than they are without it.",
        "On a part that is curved in two directions, the sizes of areas, their shapes and the lengths of lines cannot all be kept. \
         With the aim `balanced`, an outline is treated as the area that it encloses. A large ring round the top of a \
         sphere has its true length without a correction, but it encloses more than the drawn area.",
        "For truer lines, try `aim = \"lengths\"` under [correction] (`--aim lengths`): then outlines that nothing fills are \
         lines. For true areas, leave it as it is.",
    ]),
    notice([
        "lens-assumed",
        "Nobody stated the lens, so that a telecentric one is assumed.",
        "Under a telecentric lens, the height of the part does not shift the mark. Standard f-theta lenses, such as F160 and F254, are not \
         telecentric: they mark lower places larger and higher places smaller. The message states by how much such a lens over this field \
         would move marks of this drawing against each other. The errors in the report are those of a telecentric lens. The note appears \
         only if that is more than 0.1 mm.",
        "Measure the lens with `isomark calibrate lens`, which enters it into the station's settings; or set `kind = \"telecentric\"` under \
         [optics], if the lens is telecentric.",
    ]),
    reason([
        "lens-not-determined",
        "The measurements do not determine the lens.",
        "The lens distances follow from how much smaller the same crosses are marked on a higher plate. That needs measurements along \
         x and along y, on plates at two or more heights.",
        "Measure the crosses on a second, higher plate, and fill in more cells of the table.",
    ]),
    notice([
        "lens-residual",
        "The measurements do not fit two lens distances.",
        "The measured values differ from the lens that fits them best by more than three times as much as `--reading` states. A value is \
         wrong, or the beams of this lens do not seem to meet in two points, as those of short lenses with a wide field. The lens \
         distances are then wrong towards the rim of the field.",
        "Check the value that is named. If all are right, measure five crosses along each side (`isomark calibrate lens --draw DIR --crosses \
         5`), and write a lens table with `--table`.",
    ]),
    notice([
        "lens-table-residual",
        "The beams of the lens table are not known well.",
        "isomark puts polynomials through the rows of `table` under [optics], and compares each row with what all the others predict. \
         The numbers are these distances. They are large if the readings scatter, if a row is wrong, or if the lens bends the field \
         more than so few crosses show. The length errors of the report are those of a lens that is as the table describes it.",
        "Measure again with a finer tool, at more crosses (`isomark calibrate lens --draw --crosses 5`) and on plates as low and as \
         high as the parts.",
    ]),
    notice([
        "lens-uncertain",
        "The lens distances are not known well.",
        "They follow from how much smaller crosses are on a higher plate. On plates that are close together, and between crosses that are \
         close together, the difference is hardly larger than the errors of the readings.",
        "Use plates that are 30 mm apart or more, and crosses far apart.",
    ]),
    reason([
        "line-away",
        "A drawing for another line waits, because the fleet does not answer.",
        "A rule under [route] names another line for this drawing. The database of the fleet cannot be reached, or the station was started with `--once`. The drawing stays in the hot folder and nothing is lost.",
        "No action is needed: it continues when the fleet answers. `isomark status` shows what is wrong with the fleet. To mark it here, remove the rule and drop the drawing again.",
    ]),
    notice([
        "line-weight-unused",
        "Lines have a large line weight, and are marked without it.",
        "A line weight is the width in which a line is shown and plotted; it may be that of the layer. A laser marks the line itself, \
         as wide as its spot. Line weights up to 0.35 mm are usual in any drawing and are not reported.",
        "To mark the width, give the polyline a global width (`PEDIT` in AutoCAD), or draw its outline with a hatch. Otherwise \
         nothing.",
    ]),
    reason([
        "list-empty",
        "The list has no row that can be marked.",
        "A list has the names of its columns in the first row, and a product in each other row.",
        "Add a row for each product.",
    ]),
    reason([
        "list-for-group",
        "A drawing with a list is for a line that several stations take from.",
        "A list gives serial numbers that continue from list to list, and each station counts its own. Two stations of a group would mark \
         the same numbers on different products, also while the fleet's database is cut off.",
        "Send the drawing with its list to one station, by the name of the station: `isomark send URL --to laser2 can@label.dxf`, or \
         `line = \"laser2\"` in the rule under [route]. Send all lists of a SKU to the same station.",
    ]),
    reason([
        "list-removed",
        "A list was removed from the hot folder too early.",
        "A drawing with a list beside it becomes one drawing for each row. The list was removed, or renamed, before isomark had made a drawing from every row.",
        "Drop the drawing and a list with the missing rows again.",
    ]),
    reason([
        "list-too-long",
        "The list has more rows than a station takes at once.",
        "A station takes up to 10,000 rows, and at most 1 GB of drawings, at once. `isomark correct --list` has no limit below a \
         million rows.",
        "Split the list.",
    ]),
    reason([
        "list-unreadable",
        "The list of products cannot be read.",
        "The file is not CSV in UTF-8, a row has more or fewer values than there are columns, a quote is not closed, or a value contains control characters. The message names the line and the column.",
        "Correct this row, or set `bad_rows = \"skip\"` under [content] to leave such rows out.",
    ]),
    reason([
        "log-is-folder",
        "The log file is a folder.",
        "`log.file` in the station's file must name a file.",
        "Name a file, for example `log/station.log`.",
    ]),
    reason([
        "map-folded",
        "The drawing would lie folded over itself on the part.",
        "The part curves so strongly under the drawing that no map without folds was found. The coordinate in the \
         reason is the place of the fold.",
        "Make the drawing smaller, or place it where the part is less strongly curved.",
    ]),
    reason([
        "map-not-found",
        "No map that keeps the lengths was found.",
        "The search for the map failed: the part is too steep or too rough under the drawing, so that the equations \
         have no solution, or there is not enough memory.",
        "Place the drawing where the part is less steep, or make it smaller. Export a rough part again with a \
         smaller deviation.",
    ]),
    notice([
        "map-unsettled",
        "The search for the best map stopped early.",
        "After the last step the map still moved. The part is rough under the drawing, and a map with smaller \
         length errors may exist. The report's lengths are those of the delivered map.",
        "Look at the length error in the report. If it is too large, export the part with a smaller deviation, or \
         place the drawing elsewhere.",
    ]),
    notice([
        "mark-misnamed",
        "Faces of the part have nearly the name that bounds where ink may be.",
        "A body, group or material named `mark` bounds where ink may be. Other spellings, such as `MARK`, or `mark.001` as \
         Blender names copies, have no effect, because they may be names of something else.",
        "Name the faces `mark` if they are meant to bound the ink, and export again.",
    ]),
    notice([
        "marked-as-drawn",
        "The drawing is marked as it is drawn, because no correction keeps it truer.",
        "A correction must not be worse than none. Where the map leaves more of what `aim` keeps first than the drawing as it is, \
         and no other map does better, the drawing stays as it is: rings round the top of a ball keep their lengths, and a \
         part with fine roughness has no smooth map that keeps angles better.",
        "Check the values of the report. If another value matters more, choose another `aim` under [correction]; \
         `isomark evaluate` compares them.",
    ]),
    reason([
        "marked-elsewhere",
        "The rejected file was not put back because another station may have marked it.",
        "The drawing was a job from the fleet that was given to another station (`job-taken-over`). Put back into the hot folder here, it \
         would be marked a second time.",
        "See `isomark fleet status` for where the job is. If no other station marks it, run `isomark retry station.toml NAME --force`.",
    ]),
    notice([
        "marked-twice",
        "Lines of the drawing are on other lines.",
        "The laser marks these stretches more than once, which makes them darker and deeper. Often a contour was copied, or the common side of two shapes is drawn with each of them. `overlap_mm` under [pattern] is the length above which this is reported.",
        "Remove the copies in the drawing program, or join shapes that share an edge.",
    ]),
    both([
        "measurement-contradicts",
        "A measured value contradicts the others.",
        "`isomark calibrate` and `isomark register` compare each measured value with the one that follows from all others. One value \
         that is clearly different was probably mistyped; it is left out, with a warning. If many values contradict each other, \
         there is no result.",
        "Look at the named value in the table, correct it or measure it again, and run the command again.",
    ]),
    reason([
        "measurements-swapped",
        "Measured coordinates are interchanged or have the wrong sign.",
        "On a plate that is only turned and shifted, x and y keep their order and their directions. The measured values are a mirror \
         image of the drawing.",
        "Exchange the two columns, or measure x to the right and y upwards.",
    ]),
    reason([
        "measurements-unit",
        "The readings are in another unit than mm.",
        "All marks are measured smaller or larger than drawn by a factor that is that of a unit, such as 0.0394 for inches. No marking \
         software is off by as much.",
        "Give all readings in mm, and run the command again.",
    ]),
    reason([
        "measurements-unreadable",
        "A table of measurements cannot be read.",
        "`isomark calibrate` and `isomark register` read tables with a line of column names and one line for each measurement, as \
         spreadsheets write them. The place gives the line and the column.",
        "Correct the cell, keep the line of column names, and save the table as CSV text.",
    ]),
    reason([
        "mesh-buffer-missing",
        "A `.bin` file that the part names cannot be read.",
        "A `.gltf` file stores its geometry in other files beside it.",
        "Put the named file into the part's folder, or export the part as `.glb`, which is one file.",
    ]),
    reason([
        "mesh-buffer-name",
        "The part names a buffer by something other than a plain file name.",
        "isomark reads only files in the part's own folder. Paths to other folders and web addresses are refused.",
        "Put the `.bin` file beside the part and name it there without a path, or export the part as `.glb`.",
    ]),
    reason([
        "mesh-buffer-short",
        "A buffer of the part is shorter than the part states.",
        "The `.bin` file (or the binary part of the `.glb`) was cut while it was copied, or belongs to another \
         version of the part.",
        "Copy the files again after the export has ended, or export the part as `.glb`.",
    ]),
    reason([
        "mesh-compression-invalid",
        "Compressed geometry of a glTF file cannot be decoded.",
        "The data of `EXT_meshopt_compression` or `KHR_draco_mesh_compression` are damaged, incomplete or do not contain what \
         their description states. The reason gives the place and the problem.",
        "Export the part again. If that does not help, export it without compression.",
    ]),
    reason([
        "mesh-coordinate-not-finite",
        "A vertex has a coordinate that is not a number.",
        "The file contains NaN or infinity. Some modelling programs write this for broken vertices. The reason \
         names the vertex or the line.",
        "Remove the broken vertices in the modelling program (in Blender: Mesh > Clean Up) and export again.",
    ]),
    reason([
        "mesh-coordinate-too-far",
        "A vertex is too far from the origin.",
        "No part on a marking table is that large. Usually the unit is wrong, or a stray vertex is far from the \
         part.",
        "Delete stray vertices. If the whole size is wrong, set the unit with `unit` under [part] or \
         `--part-unit`.",
    ]),
    reason([
        "mesh-data-beyond-buffer",
        "The part's data reach beyond the end of their buffer.",
        "An accessor or buffer view of the glTF file needs more bytes than there are. The file is damaged, or its \
         exporter is defective.",
        "Export the part again. If it happens again, export as OBJ instead.",
    ]),
    reason([
        "mesh-data-missing",
        "A part of the geometry has no data.",
        "The file describes triangles or positions, but contains no data for them.",
        "Export the part again. If it happens again, export as OBJ instead, or without compression.",
    ]),
    reason([
        "mesh-data-type",
        "The geometry is stored in a number format that glTF does not allow here.",
        "Positions must be 32-bit floating-point numbers, or integers with the extension for quantized meshes \
         (KHR_mesh_quantization).",
        "Export the part again with positions as 32-bit floats.",
    ]),
    reason([
        "mesh-data-uri",
        "Data inside the glTF file are not valid base64.",
        "The file contains its buffers as text, and this text is damaged.",
        "Export the part again, as `.glb`.",
    ]),
    reason([
        "mesh-empty",
        "The file contains no triangle with an area.",
        "Usually only sketches, lines or points were exported, the part was hidden, or FreeCAD without a window \
         exported a shape that was not meshed. The message names the likely cause.",
        "Select the solid or the mesh before the export and check that it is visible. In FreeCAD scripts, mesh \
         the shape first (`MeshPart.meshFromShape`).",
    ]),
    reason([
        "mesh-extension-unsupported",
        "The file requires a glTF extension that isomark does not read.",
        "A required extension may change how the geometry is stored. isomark reads Draco, meshopt and quantized meshes.",
        "Export without the extension named in the reason.",
    ]),
    reason([
        "mesh-header-invalid",
        "The header of the file cannot be used.",
        "A PLY file needs the vertex properties x, y and z in its header; a list of points needs columns that can \
         be recognised. The reason gives the line and the problem.",
        "Export the scan again as PLY, or write one point per line as `x y z`.",
    ]),
    reason([
        "mesh-index-out-of-range",
        "A face refers to a vertex or normal that does not exist.",
        "The file is damaged, or was edited by hand.",
        "Export the part again.",
    ]),
    reason([
        "mesh-json-invalid",
        "The JSON of the glTF file cannot be read.",
        "The reason gives line and column. The file is damaged, or its exporter is defective.",
        "Export the part again. If it happens again, export as OBJ instead.",
    ]),
    reason([
        "mesh-line-invalid",
        "A line of the file cannot be understood.",
        "Common causes are a comma as decimal sign, a coordinate that is missing, or a damaged file. The reason \
         gives the line and the problem.",
        "Correct the line, or export the part again with a point as decimal sign.",
    ]),
    reason([
        "mesh-node-cycle",
        "The nodes of the glTF file form a cycle.",
        "A node is its own descendant, or belongs to two parents. glTF forbids both, because the position of the \
         part would be ambiguous.",
        "Export the part again as `.glb`.",
    ]),
    notice([
        "mesh-noisy",
        "The vertices of the mesh scatter so much that its normals mislead.",
        "The mesh was measured, and its vertices are not on a smooth surface. Vertices that are close together and a \
         little off tilt the surface between them by degrees, which changes lengths on the part. With `normals = \
         \"auto\"` isomark smooths such a mesh like a scan; sharp edges are then rounded.",
        "Export the part from CAD, or smooth the mesh before the export. `normals = \"estimate\"` under [part] (`--normals \
         estimate`) follows every vertex instead.",
    ]),
    reason([
        "mesh-normals-wild",
        "The normals in the file are unrelated to the facets of the part.",
        "A large share of the side that faces the laser has normals that lean more than 66 degrees from their facets. Such normals are \
         damaged, and it is not known which of the two is right.",
        "Recalculate the normals (in Blender: Mesh > Normals > Reset Vectors) and export again, or set `normals = \"estimate\"` \
         under [part] (`--normals estimate`), which takes them from the facets.",
    ]),
    notice([
        "mesh-not-smoothed",
        "The mesh is noisy, but its vertices are too far apart to be smoothed like a scan.",
        "isomark smooths noisy meshes like scans (see `mesh-noisy`). Here the vertices cover too little of the part for that, \
         so the normals are estimated from the facets, and the noise remains.",
        "Export the part from CAD, or export a finer or smoother mesh.",
    ]),
    reason([
        "mesh-package-invalid",
        "The content of a 3MF file cannot be read.",
        "An entry of the package is missing, damaged, encrypted or not valid 3MF, or its components contain themselves. The \
         reason gives the entry, the place in it and the problem.",
        "Export the part as 3MF again, or as GLB.",
    ]),
    reason([
        "mesh-reference-broken",
        "An entry of the glTF file refers to another one that does not exist.",
        "The file is damaged, or was edited by hand.",
        "Export the part again. If it happens again, export as OBJ instead.",
    ]),
    reason([
        "mesh-refused",
        "The file passed all checks but still cannot be parsed.",
        "The parser found a mistake that isomark's own checks do not cover. The message contains the parser's \
         words.",
        "Export the part as `.glb` instead.",
    ]),
    reason([
        "mesh-too-large",
        "The part has more triangles, vertices or points than isomark processes.",
        "The limit protects the memory. No marking needs such a fine mesh.",
        "Reduce the mesh (decimate it, or export with a larger deviation), or thin out the scan.",
    ]),
    reason([
        "mesh-transform-invalid",
        "The position, rotation or scale of a node is not finite.",
        "The glTF file contains a transform with NaN or infinity.",
        "Apply the object's transform in the modelling program (in Blender: Object > Apply > All Transforms) and \
         export again.",
    ]),
    reason([
        "mesh-truncated",
        "The part file is cut off before its end.",
        "The file is shorter than its header states, or its last line is incomplete: the export or copy was \
         interrupted, or has not ended yet. In the hot folder the file waits for `watch.incomplete_s`, or for 3 s \
         after its writer closed it, and is then rejected.",
        "Wait until the export has ended, then copy the file again.",
    ]),
    reason([
        "mesh-version-unsupported",
        "The file is not glTF 2.",
        "isomark reads glTF version 2 only. Files of version 1 were written until about 2017.",
        "Export the part as glTF 2 (`.glb`) or OBJ, or convert it: `gltf-pipeline -i old.gltf -o new.glb`.",
    ]),
    reason([
        "mesh-wrong-format",
        "The content of the file does not match its extension.",
        "The file was probably renamed, or something else was saved under this name. The reason names the format that \
         was found, or gives the first bytes, or states that the file is empty.",
        "Export the part as STEP, GLB, glTF, OBJ, STL, PLY or 3MF and keep the extension that the program writes.",
    ]),
    reason([
        "name-character",
        "The file's name contains a character that not every file system can store.",
        "The corrected drawing gets the same name, and the marking computer could not store it.",
        "Rename the file without \\ : * ? \" < > | and without control characters.",
    ]),
    reason([
        "name-misspelt",
        "Settings or a list have an ending that isomark does not read.",
        "Editors add .txt to the name of a file, and Windows hides that. A drawing is never marked without settings that were meant \
         for it: it waits until the file has its name or is removed.",
        "Rename the file as the remedy states. In the Explorer of Windows, turn on “File name extensions”.",
    ]),
    reason([
        "name-reserved",
        "The file's name is reserved for isomark's own notes.",
        "isomark stores a note under this name in the archive of each SKU.",
        "Give the scan another name.",
    ]),
    reason([
        "name-too-long",
        "The file's name is too long.",
        "Reports, pictures and notes get longer names that begin with this one, and file systems limit the length.",
        "Give the file a shorter name.",
    ]),
    reason([
        "name-unreadable",
        "The file's name is not readable text.",
        "The name contains bytes that are not valid text in the system's encoding, or leads out of the hot folder.",
        "Rename the file with plain letters and digits.",
    ]),
    notice([
        "nearly-closed",
        "Outlines are open by a small gap.",
        "The gap is larger than `joining_mm` under [pattern], so the outline stays open. The marking software \
         cannot fill it. The message names the widest gap.",
        "Close the outlines in the drawing program if they are meant as contours, or raise `joining_mm`.",
    ]),
    reason([
        "newer-done",
        "The rejected file was not put back because a newer one of the same name was delivered.",
        "`isomark retry` moves rejected files back into the hot folder. This one would replace a newer drawing or \
         part.",
        "Move the file from the rejected folder yourself if it is to replace the newer one.",
    ]),
    reason([
        "newer-elsewhere",
        "Another station has fitted a newer part for this SKU.",
        "The stations share one cache of surfaces, or another version of isomark has used the cache. This station was about to fit its \
         own archived part again, but the cache contains a newer part.",
        "Drop the newer part at this station, as well. The reason gives its name.",
    ]),
    reason([
        "no-cone",
        "The part cannot be unrolled as a cone.",
        "The method `cone` was chosen, but under the drawing the part is not a cone, too little of the part is \
         under the drawing, or the anchor is beside the cone or on its apex. The message gives the cause.",
        "Use the method `auto` or `isometric`, or place the drawing on the conical part.",
    ]),
    reason([
        "no-cylinder",
        "The part cannot be unrolled as a cylinder.",
        "The method `cylinder` was chosen, but under the drawing the part is flat or not a cylinder, too little of \
         the part is under the drawing, or the anchor is beside the cylinder. The message gives the cause.",
        "Use the method `auto` or `isometric`, or place the drawing on the cylindrical part.",
    ]),
    reason([
        "no-ink",
        "Nothing in the drawing is on the ink layers.",
        "`ink_layers` under [pattern] names layers without any lines.",
        "Name layers of the drawing in `ink_layers`, or leave it out to use all layers. The reason lists the \
         layers.",
    ]),
    reason([
        "no-mapping-domain",
        "The comparison method `mapping-domain` found no map.",
        "The drawing reaches beyond the part, or the anchor cannot be reached on the surface. This method exists \
         only for comparison.",
        "Use the method `auto` or `isometric`, or place the drawing on the part.",
    ]),
    reason([
        "no-parametrisation",
        "The comparison method `floater` found no map.",
        "The part has no outline that can be mapped to a square, the drawing reaches beyond it, or the equations \
         could not be solved. This method exists only for comparison.",
        "Use the method `auto` or `isometric`, or place the drawing on the part.",
    ]),
    notice([
        "no-true-figure",
        "The part differs from the cylinder or cone that the settings ask for.",
        "The method `cylinder` or `cone` was chosen. Under the drawing the part is up to the stated distance from \
         the fitted cylinder or cone, so lengths can be wrong.",
        "Use the method `auto`, which chooses cylinder or cone only where the part is exact enough.",
    ]),
    both([
        "normals-contradict-facets",
        "The part's normals contradict its facets, so the surface between its vertices is not known well enough.",
        "Smooth shading beside a flat side does this: the normals describe a bulge that the facets do not have. \
         The number is the height by which the real surface may differ. As a warning the job continues; above \
         `max_residual_mm` under [correction] the drawing is rejected.",
        "Export the part from CAD with its own normals or with a smaller deviation. `normals = \"estimate\"` under [part] \
         (`--normals estimate`) estimates the normals from the facets; the report states how uncertain they \
         are. In Blender, use a finer bevel or shade the part flat. Raise `max_residual_mm` only if this error is acceptable.",
    ]),
    notice([
        "normals-estimated",
        "The curvature between the vertices is estimated.",
        "The file has no normals, or normals that only repeat or average the flat facets. isomark estimates the \
         curved surface from the neighbouring facets. With coarse meshes this is less accurate than the exact \
         normals of a CAD export.",
        "Export from CAD as STEP, which contains the exact surfaces, as GLB, which contains their normals, or with a smaller \
         deviation, if the lengths must be more accurate.",
    ]),
    notice([
        "normals-missing",
        "The settings ask for the file's normals, but the file has none.",
        "With `normals = \"file\"` isomark uses the normals of the file. This file has none, so they are estimated from \
         the facets.",
        "Export the part with normals, for example as GLB, or remove the setting.",
    ]),
    reason([
        "not-a-file",
        "The drop is a link or a device, not a file.",
        "isomark does not follow links out of the hot folder.",
        "Drop the file itself.",
    ]),
    notice([
        "not-flat",
        "The drawing is not flat.",
        "Its z coordinates differ. isomark uses the view from above, so sloping lines are shorter in the mark \
         than in the file.",
        "Flatten the drawing in the drawing program (set all z to 0) and check its lengths.",
    ]),
    notice([
        "not-length-true",
        "The chosen method is for comparison and does not keep lengths.",
        "`mapping-domain`, `floater` and `none` exist to be compared with. The message gives the largest change \
         of a length.",
        "Use the method `auto` for products; `isomark evaluate` shows what each method leaves of this drawing on this part.",
    ]),
    reason([
        "not-rejected",
        "There is no rejected drop of this name.",
        "`isomark retry STATION.toml NAME` looks for the name in the rejected folder. The drop is still in the \
         hot folder, was never rejected, or has another name.",
        "Give the name that the file had in the hot folder; the first line of its `.reason.txt` states it. For \
         drops that wait in the hot folder, run `isomark retry STATION.toml` without a name.",
    ]),
    reason([
        "not-returned",
        "The rejected file cannot be moved back into the hot folder.",
        "Another file of that name is in the hot folder, or the permissions do not allow it.",
        "Let the station process the file in the hot folder first, or run the command as the user that runs the \
         station.",
    ]),
    notice([
        "not-taken",
        "Some entities of the drawing are not marked.",
        "They are of a kind that cannot be converted to lines, are hidden, or draw nothing. The message lists the \
         kinds, layers and causes, those that the drawing shows first; the report lists all. It is a warning if something that the file draws is \
         missing in the mark.",
        "Check the list. Convert what must be marked to curves in the drawing program.",
    ]),
    notice([
        "obj-normals-absent",
        "Faces of the OBJ file name normals that the file does not contain.",
        "The program that wrote the file left out normals, or numbered them wrongly. The corners without a normal are read; \
         the shape between the vertices is estimated there.",
        "Export the part with its normals, or as GLB, if the curvature must be exact.",
    ]),
    reason([
        "off-surface",
        "The drawing is not completely on the part.",
        "Part of the drawing is beyond the part's outline, over a hole or an edge, or on a side that is too steep to be \
         measured: more than 75 deg between the beam and the surface normal. A side that can be measured but is steeper \
         than `incidence_refuse_deg` under [optics] (60 deg by default) has the code `too-steep` instead. The reason gives the \
         place and the extents of part and drawing as the laser sees them.",
        "Move the drawing (`place_mm`, `--place`), make it smaller, or check `facing`. If the sizes differ by a \
         large factor, check the units of part and drawing, and delete stray lines.",
    ]),
    notice([
        "out-of-focus",
        "The ink spans more height than the focus depth.",
        "The highest and lowest point under the ink differ by more than `focus_depth_mm` under [optics]. Marks \
         are wider and paler at the ends of this range.",
        "Set the focus to the height in the message to spread the blur evenly, or mark the drawing in several jobs.",
    ]),
    notice([
        "outline-only",
        "An outline encloses places that cannot be marked, and only its line counts.",
        "Inside a closed outline that nothing fills (no HATCH, no `--fill`) there is a hole, an edge or a side that is too steep, \
         as inside a dial round a shaft. All its lines are on the part, so it is marked. What it encloses is no area then: it is \
         neither checked nor in the area errors. Lines and filled areas beside the part are still rejected.",
        "Make sure that the marking program does not fill the outline. If it must be filled, move it away from the hole.",
    ]),
    reason([
        "outside-field",
        "The corrected drawing reaches beyond the marking field.",
        "The field is the working area under [field] in the station's settings. The number is the overhang in mm.",
        "Move the drawing (`place_mm`, `--place`), or move the part with [fixture].",
    ]),
    both([
        "outside-lens-table",
        "The drawing needs beams that the lens table does not contain.",
        "`table` under [optics] gives beams as they were measured. A drawing is rejected if it reaches more than a tenth of the \
         measured rectangle beyond it; the number is by how much, in mm. As a warning, the ink is far above or below the \
         measured heights.",
        "Move the part or the drawing towards the middle of the field, or measure more crosses and add them to the table.",
    ]),
    both([
        "outside-mark",
        "Ink is outside the faces of the part that are named `mark`.",
        "Faces with a material, group, object or mesh named `mark` bound where ink may be. Some of the ink would be \
         outside them, or where other parts hide them from the laser. The reason gives the place in the view that is \
         farthest outside. With `outside_mark = \"warn\"` isomark corrects the drawing and only warns.",
        "Move the drawing (`place_mm`, `--place`, or the marking frame), make it smaller, or give the name `mark` to \
         more faces. If ink may be there, set `outside_mark = \"warn\"` under [placement].",
    ]),
    reason([
        "overtaken",
        "An older file was written again after a newer file of the same name had arrived.",
        "The file in the hot folder waits, because it would replace the newer one.",
        "Drop the file again if it is to replace the newer one. Otherwise remove it.",
    ]),
    reason([
        "page-address",
        "The page of the station cannot be opened at its address.",
        "`--page` or `address` under [page] names an IP address of this computer and a port. Another program uses that port, \
         often a second station or a program that was not stopped, or the address is not one of this computer. The station \
         works without its page and tries again every 5 s.",
        "Stop the other program, or give another port, for example `--page 127.0.0.1:4781`. Every station needs its own.",
    ]),
    reason([
        "page-password",
        "The password of the station's page cannot be read.",
        "`password_file` or `password_variable` under [page] names the place of the password. The file or variable is missing, \
         empty, not readable for the user of the station, or has fewer than 8 characters. The page stays closed, the station \
         works without it, and isomark tries again every 5 s.",
        "Write a password of at least 8 characters on the first line of the file, readable only for the user that runs the \
         station.",
    ]),
    reason([
        "part-above-lens",
        "The part reaches above the lens.",
        "A perspective lens (`optics.kind`) sees no point at or above its own centre. The height of the part or \
         of the fixture cannot be right.",
        "Check `z_mm` under [fixture] and the lens distances under [optics].",
    ]),
    reason([
        "part-format-unknown",
        "The file is a part in a format that isomark does not read.",
        "isomark reads STEP files, meshes and scans, but not other formats of CAD programs, such as IGES or their own ones.",
        "Export the part as STEP, GLB, glTF, OBJ, STL, PLY or 3MF, or a scan as PLY or list of points.",
    ]),
    notice([
        "part-hidden",
        "The file hides objects, which were left out.",
        "An object of a glTF file is hidden by `KHR_node_visibility`, and one of a 3MF file is not printed because of \
         `printable=\"0\"`. Other programs do not show or print it, so it is not read as part of the product.",
        "Nothing to do if the laser does not meet it. Otherwise show the object in the program that wrote the file, and export again.",
    ]),
    reason([
        "part-not-needed",
        "The settings give this part by its sizes, so no file is read for it.",
        "`shape` under [part] is \"cylinder\" or \"cone\" for this SKU.",
        "Remove the part file. Or set `shape = \"mesh\"` in the SKU's settings to use the file.",
    ]),
    reason([
        "part-rejected",
        "The newest part of this SKU was rejected, and its older shape is not used.",
        "A drawing on the older shape could be wrong on the products that are made now. The drawing waits.",
        "Drop a valid part of this SKU. Or remove the rejected part from the rejected folder to continue with the \
         older shape.",
    ]),
    both([
        "part-too-thin",
        "The part is too thin as the laser sees it.",
        "Its width or height in the view is almost zero. Usually the unit is wrong or `facing` names an edge of a \
         thin part.",
        "Check the part's unit (`unit` under [part], `--part-unit`) and `facing`.",
    ]),
    both([
        "part-two-skins",
        "The part has two surfaces, one closely behind the other, and both face the laser.",
        "isomark cannot decide which of the two to mark. Usually an object is there twice, or a label was modelled a little \
         above the body. The message gives the distance, and the place in the view.",
        "Remove the copy that is not needed, and export the part again.",
    ]),
    both([
        "part-without-surface",
        "Hardly any of the side that faces the laser can be marked.",
        "Almost all of the part is steeper than the limit as the laser sees it. Usually `facing` names another \
         side, or the up axis is wrong.",
        "Check `facing` and `up` under [part], and look at the preview.",
    ]),
    reason([
        "pattern-group-code",
        "A group code of the DXF file cannot be read.",
        "DXF consists of pairs of a group code and a value. At this place the order is broken: the file is \
         damaged, or was edited by hand.",
        "Export the drawing again.",
    ]),
    reason([
        "pattern-not-dxf",
        "The file is not a drawing in the format that is expected.",
        "The reason states what the content looks like, for example DWG or PDF. A drawing is recognised by its \
         content, not by its name.",
        "Export the drawing as DXF (R12 to R2018, text or binary) or plain SVG, or save a picture as PNG or BMP.",
    ]),
    reason([
        "pattern-nothing-to-mark",
        "The drawing contains nothing that can be marked.",
        "It is empty, contains only entities that cannot be converted to lines, or everything is hidden. Inkscape \
         leaves out live text, for example. The remedy in the reason fits the cause that was found.",
        "Convert texts and solids to curves, show their layers, and export again. With a picture, check the \
         threshold (`threshold_percent`, `--threshold`).",
    ]),
    reason([
        "pattern-number",
        "A number in the DXF file cannot be read.",
        "Common causes are a comma as decimal sign, NaN, or a damaged file. The reason gives the line and the \
         entity.",
        "Export the drawing again with a point as decimal sign, or delete the entity.",
    ]),
    reason([
        "pattern-out-of-range",
        "An entity is too far from the origin.",
        "A stray entity is far away, or the drawing has map coordinates or another unit.",
        "Delete the stray entity, or move the drawing near the origin and check its unit.",
    ]),
    reason([
        "pattern-recursive-block",
        "A block contains itself.",
        "The drawing program would expand it without end.",
        "Explode the block in the drawing program, or purge the drawing, and export again.",
    ]),
    reason([
        "pattern-too-large",
        "The drawing file is larger than isomark reads.",
        "The limit protects the memory.",
        "Export only what is to be marked, with fewer points.",
    ]),
    reason([
        "pattern-too-many",
        "The drawing expands to more pieces than can be processed.",
        "Nested blocks, dense hatches or arrays multiply their content. The reason names the entity at which the \
         limit was reached.",
        "Simplify the drawing, or mark it in several jobs.",
    ]),
    reason([
        "pattern-truncated",
        "The drawing file is cut off before its end.",
        "A DXF file ends with EOF, an SVG file with </svg> and a picture with its end mark. The export or copy was interrupted, or has not \
         ended yet. In the hot folder the file waits for `watch.incomplete_s`, or for 3 s after its writer closed \
         it, and is then rejected.",
        "Wait until the export has ended, then copy the file again.",
    ]),
    notice([
        "picture-animated",
        "Only the first frame of an animated picture is marked.",
        "The file contains several frames.",
        "Save the frame that is to be marked as a plain PNG.",
    ]),
    reason([
        "picture-damaged",
        "The picture cannot be decoded.",
        "The file is damaged, or uses a variant of the format that isomark does not read.",
        "Open it in a picture program and save it as PNG.",
    ]),
    notice([
        "picture-ground",
        "Most of the picture is marked, including its border.",
        "Dark pixels are marked. In a light drawing on a dark ground that is the ground.",
        "Use `invert = true` under [pattern] (`--invert`) if the ground must stay blank.",
    ]),
    notice([
        "picture-hard-edges",
        "The picture has hard edges without shades of grey.",
        "Outlines that slant follow the squares of the pixels and are accurate to about half a pixel only. A \
         picture with smooth (anti-aliased) edges gives more accurate outlines.",
        "Export the picture with anti-aliasing or with more pixels, or use DXF, if the outlines must be smoother.",
    ]),
    notice([
        "picture-resolution",
        "The size comes from a resolution that many programs write by default.",
        "72 or 96 pixels per inch are usual defaults of programs, so the size in mm may be accidental.",
        "Check the size in the report. Set `width_mm` under [pattern] (`--width`) if it is wrong.",
    ]),
    notice([
        "picture-shades",
        "Much of the picture is neither dark nor light.",
        "isomark marks outlines at a threshold. It does not convert shades to dots (halftone), so a photograph \
         loses its shades.",
        "Use a picture in black and white. Change `threshold_percent` (`--threshold`) to move the border between \
         dark and light.",
    ]),
    reason([
        "picture-size",
        "The picture has no size in mm.",
        "A picture consists of pixels, and this file does not state a resolution (dpi).",
        "Set `width_mm` under [pattern] or `--width`, or export the picture with its resolution.",
    ]),
    notice([
        "picture-specks",
        "Many outlines are specks of a few pixels.",
        "Usually these are noise of a scan or artefacts of JPEG compression. Each one is marked.",
        "Clean the picture, or change `threshold_percent` (`--threshold`).",
    ]),
    notice([
        "picture-stretched",
        "The picture or page is stretched to the given size.",
        "`width_mm` and `height_mm` have another ratio than the picture or the page.",
        "Give only one of them to keep the ratio.",
    ]),
    reason([
        "picture-too-large",
        "The picture has more pixels than isomark reads.",
        "The limit protects the memory. A laser spot is far larger than such a pixel.",
        "Export the picture with fewer pixels; 600 per inch are enough.",
    ]),
    notice([
        "picture-turned",
        "The picture was rotated or mirrored as its file states.",
        "Cameras and phones store the orientation beside the pixels (Exif). isomark shows the picture as other \
         programs do.",
        "Check the orientation in the preview.",
    ]),
    notice([
        "pieces-joined",
        "Loose pieces were joined to contours and lines.",
        "Many programs export an outline as separate lines and arcs. Ends that are closer than `joining_mm` under \
         [pattern] were joined. The report lists the places.",
        "Nothing to do. Set `strict = true` (`--strict`) or `joining_mm = 0` to keep the pieces separate.",
    ]),
    reason([
        "plan-empty",
        "The drawing for a production line has no lines.",
        "A plan needs the corrected drawing with everything that the laser marks.",
        "Name a corrected drawing.",
    ]),
    reason([
        "plan-outside-field",
        "The drawing is wider than the field, across the belt.",
        "The belt moves the product through the field in one direction only. Across the belt, the whole drawing must be inside \
         the field.",
        "Make the drawing narrower, turn the part, or divide the drawing between lasers side by side.",
    ]),
    reason([
        "plan-tiles",
        "A drawing in tiles passes a laser more than once.",
        "The layers of the drawing are tiles of a mark round a part (`--rotary`). The part turns between them, so its lines cannot be \
         marked in one pass on a belt.",
        "Plan one tile at a time (`--tiles-as files`), and add the time that the rotary axis needs to turn.",
    ]),
    notice([
        "point-symbols",
        "Points that the drawing shows as symbols are marked as dots.",
        "`$PDMODE` in the DXF file gives all points of the drawing a symbol, such as a cross or a circle. A laser marks the point itself. If \
         `$PDMODE` is 1, the drawing shows no points, and none is marked.",
        "To mark symbols, draw them as lines or blocks. Otherwise set `PDMODE` to 0 in the drawing program, and save the drawing again.",
    ]),
    reason([
        "pose-not-determined",
        "The points do not determine where the part stands.",
        "`isomark register` needs three points of the part that form a triangle, or points on two edges that meet at an angle, each \
         with the point of the field that hits it. The number shows what is missing.",
        "Add points or edges that are far apart and not on one line, and check the height of the part and the lens.",
    ]),
    reason([
        "readback-differs",
        "The written drawing differs from the corrected one.",
        "A second, independent reader checks the written file before it is delivered. It found another vertex, \
         layer, colour or unit. Nothing was delivered.",
        "Check the disk, the network and the computer's memory, then try again. If the same drawing is refused \
         again, it is a defect in isomark: keep the drawing and report it.",
    ]),
    reason([
        "result-of-another",
        "The result would replace that of another drawing in the import folder.",
        "A result has the name of its drawing with the ending .dxf: `can@logo.dxf` and `can@logo.svg` both become \
         `can@logo.dxf`. The result of the first is still in the import folder, and replacing it would lose a mark that \
         its designer knows as delivered.",
        "Rename one of the drawings. If the new one replaces the other, remove the result of the other from the import folder, \
         then drop the new one again.",
    ]),
    reason([
        "result-of-another-station",
        "The result would replace a corrected drawing that this station has not delivered.",
        "The import folder has a corrected drawing of this name. Neither the journal of this station nor its reports show that it \
         delivered this file: another station uses the same import folder, or somebody changed or restored the file. With \
         `comments = false` results cannot be recognised, and are replaced.",
        "Give each station its own import folder, or rename the drawing. If the file is not needed, remove it from the import folder. Then \
         drop the drawing again.",
    ]),
    notice([
        "rotary-as-layers",
        "The tiles of a mark round the part are layers, because a station delivers one file for each drawing.",
        "The settings ask for one file for each tile. A station delivers every drawing exactly once, as one file that appears \
         completely or not at all; several files could be delivered in part. So the tiles are layers of this file, named after \
         the angle of the rotary axis.",
        "Set `as = \"layers\"` under [rotary], or write the files with `isomark correct --tiles-as files`.",
    ]),
    reason([
        "rotary-hollow",
        "A mark in tiles was requested on the inside of a hollow cylinder or cone.",
        "Between two tiles the part turns about its axis. When the laser looks at the inside of a part, the other side of the \
         part is in the way after a turn.",
        "Check `facing`, or set `tiles = \"off\"` under [rotary].",
    ]),
    reason([
        "rotary-method",
        "A mark in tiles was requested with a method that does not unroll the part.",
        "A mark that goes round closes on itself only if the part is unrolled exactly, as a cylinder or cone.",
        "Set `method` to \"auto\", \"cylinder\" or \"cone\" under [correction], or `tiles = \"off\"` under [rotary].",
    ]),
    notice([
        "rotary-more-tiles",
        "More tiles were requested than the drawing can use.",
        "The drawing has gaps, and fewer tiles would be as narrow as those requested. Contours that fit into a tile are cut only \
         to reach the number.",
        "Set `tiles` under [rotary] to the number in the notice, or to \"auto\".",
    ]),
    reason([
        "rotary-no-room",
        "The laser can mark hardly anything of the part between two turns.",
        "isomark looks for the widest tile in which all ink is on the part, inside the field, in focus, and hit by the beam at \
         less than `incidence_warn_deg` (`incidence_refuse_deg` if the number of tiles is given). Here it is narrower than half \
         a degree.",
        "Move the part nearer to the lens axis and enter its position under [fixture], or check the limits under [optics] and \
         [field].",
    ]),
    reason([
        "rotary-not-round",
        "A mark in tiles was requested on a part that is neither a cylinder nor a cone.",
        "isomark fits a cylinder and a cone to the side that faces the laser, where the drawing's anchor is. Both are farther \
         from the part than 0.005 mm, so the other sides of the part are not known.",
        "Check `facing` and `place_mm`: the anchor must be on the round side. For a part that is not quite round, give its sizes \
         (`shape`, `--cylinder`, `--cone`) or set `method = \"cylinder\"` or `\"cone\"`.",
    ]),
    notice([
        "rotary-other-sides",
        "The sides of the part that face the laser only after a turn were not examined.",
        "A mark in tiles takes the part as a cylinder or cone all the way round, as it is on the side that faces the laser. \
         Handles, holes and flats on the other sides are not known, and faces named `mark` are checked as if they were the same all the way round.",
        "Check that the part is the same all the way round where the drawing is.",
    ]),
    reason([
        "rotary-overlap",
        "The overlap of tiles is too wide for the tiles.",
        "Where a contour is cut, both tiles continue by half of `overlap_mm` beyond the border. It must be less than half the \
         width of the widest tile.",
        "Make `overlap_mm` under [rotary] smaller, or `max_tile_deg` larger.",
    ]),
    reason([
        "rotary-tiles",
        "The drawing cannot be divided into the number of tiles that the settings ask for.",
        "Each tile must have ink, and must not be wider than the laser can mark between two turns. Contours are not cut into pieces \
         narrower than half a degree or than twice the overlap.",
        "Set `tiles` under [rotary] to the number in the reason, or to \"auto\".",
    ]),
    reason([
        "rotary-too-wide",
        "The drawing is longer than the circumference of the part.",
        "Its ends would be marked over each other. The circumference is pi times the diameter; on a cone, a drawing is as wide \
         as the angle that it spans about the axis.",
        "Make the drawing narrower, or check its unit and the part's diameter.",
    ]),
    reason([
        "row-name-taken",
        "A row of a list cannot get its name in the hot folder.",
        "Each row becomes a drawing that is named after the list's drawing and the serial number. A file in the hot folder has this name.",
        "Move that file out of the hot folder; isomark then continues automatically.",
    ]),
    reason([
        "scan-empty",
        "The scan contains no points.",
        "The file is empty, or all its points are marked as missing, at infinity or too far away.",
        "Check that the scanner has seen the part, and export the scan again.",
    ]),
    notice([
        "scan-noisy",
        "The points of the scan scatter widely.",
        "The scatter is that of a depth camera, about ten times that of a scanner for parts. Lengths can be wrong \
         by as much as the message states.",
        "Use a more accurate scanner or average several scans, if the lengths must be more accurate.",
    ]),
    both([
        "scan-not-smoothed",
        "The scan could not be smoothed.",
        "The equations for the smooth surface could not be solved with these points.",
        "Set `smoothing = \"low-pass\"` under [part] for this part, or scan it again.",
    ]),
    notice([
        "scan-points-dropped",
        "Many points of the scan were dropped as outliers.",
        "Points far from the surface of their neighbours are not used. More than a tenth of the scan was dropped.",
        "Check the surface in the preview. Scan again without reflections, dust spray or the table in view, if \
         something is missing.",
    ]),
    notice([
        "scan-points-far",
        "The scan contains points at infinity or very far away.",
        "A coordinate is infinite, or farther than 100 m from the origin. Such points do not belong to a part. \
         They were left out; the message gives their number and, for those at infinity, the place of the first.",
        "Check the part's unit, and export the scan again if the scanner saw something there.",
    ]),
    notice([
        "scan-points-missing",
        "The scan contains points that are marked as missing.",
        "Scanners write NaN or (0, 0, 0) for directions in which they saw nothing. These points were left out.",
        "Nothing to do, unless the part has holes where it was not seen.",
    ]),
    notice([
        "scan-rounded",
        "Smoothing rounded an edge of the scan.",
        "The smoothed surface departs from the points by more than noise explains, usually at an edge. The \
         message gives the place.",
        "Place the drawing beside the edge, or smooth less (`smoothing` and `low_pass_mm` under [part]).",
    ]),
    notice([
        "scan-smoothed",
        "The surface was fitted through the points of a scan.",
        "The message states how many points were used, how far they scatter, and which wavelengths were smoothed. Another states the cylinder or cone on which the points are, if there is one, and how uncertain its size is.",
        "Nothing to do. `smoothing` under [part] changes it.",
    ]),
    both([
        "scan-too-few-points",
        "The scan has too few points that face the laser.",
        "If the points have normals, those that face away from the laser are not used.",
        "Scan the part with closer points, and check `facing` under [part].",
    ]),
    both([
        "scan-without-area",
        "The points of the scan form only a line or a spot as the laser sees them.",
        "Usually `facing` or the order of the columns is wrong, or the file contains a single profile.",
        "Check `facing`, the unit and the order of the columns. Scan an area, not a line.",
    ]),
    both([
        "scan-without-surface",
        "The points of the scan do not form a surface.",
        "Neighbouring points jump in height everywhere. Usually the unit or `facing` is wrong, the points are too \
         far apart, or the order of the columns is wrong.",
        "Check the part's unit and `facing`, or scan with closer points.",
    ]),
    reason([
        "serial-used-up",
        "All serial numbers are used.",
        "`last` under [serial] is the last number that may be used. The list has more rows than there are numbers from `start` on.",
        "Give a new range, `start` and `last` under [serial], or a shorter list.",
    ]),
    reason([
        "serials-lost",
        "It is unknown which serial numbers are used.",
        "A station keeps the serial numbers of a SKU in its journal and in `archive/<sku>/serial-numbers.json`. The journal was \
         lost, and that file is damaged, so a list might get numbers that are marked already.",
        "Set `start` under [serial] to a number above the last one that was marked, and remove the file.",
    ]),
    reason([
        "settings-being-saved",
        "The settings are being saved at the moment.",
        "The settings file changed a moment ago and may not be complete. Jobs wait until it is stable.",
        "Nothing: isomark reads the file again in a moment.",
    ]),
    reason([
        "settings-choice",
        "The side that faces the laser has an unknown name.",
        "The library function `Settings::facing` accepts `+z`, `-z`, `+x`, `-x`, `+y`, `-y`, or a direction as \
         three numbers.",
        "Name a side such as `-y`.",
    ]),
    reason([
        "settings-contradiction",
        "A value is not possible here, or contradicts another setting.",
        "The value is not allowed for this key (for example a side that does not exist), or two settings exclude each other. The \
         message names them.",
        "Look up the key in `watch-config/station.toml`, which explains each key and the values that it allows.",
    ]),
    reason([
        "settings-missing-key",
        "A required key is missing in the settings.",
        "The reason names the table and the key.",
        "Add the key; the sample in `watch-config/station.toml` explains it.",
    ]),
    reason([
        "settings-out-of-range",
        "A number in the settings is outside its range.",
        "The reason gives the key, the number and the limit.",
        "Give a number in the range that the remedy states, in the unit that the key's name ends with.",
    ]),
    reason([
        "settings-syntax",
        "The settings are not valid TOML, or a value has the wrong type.",
        "Common mistakes are missing quotes around text, quotes around numbers, and backslashes in Windows paths.",
        "Correct the line. Write paths with forward slashes, or in single quotes: 'C:\\laser\\import'.",
    ]),
    reason([
        "settings-twice",
        "Two settings files are for the same SKU.",
        "SKU names that differ only in upper and lower case, or in how accents are composed, are the same SKU. \
         A station keeps the settings that it used before; if there are none, the drawings of the SKU wait.",
        "Keep one of the two files.",
    ]),
    reason([
        "settings-unknown-choice",
        "A value in the settings is not one of the choices.",
        "The value is misspelt, or belongs to another key or version. The remedy lists the choices.",
        "Use one of the listed names.",
    ]),
    reason([
        "settings-unknown-key",
        "A key in the settings is unknown at this place.",
        "The key is misspelt, is in the wrong table, or belongs to another version. isomark refuses unknown keys \
         because a misspelt limit would have no effect.",
        "Correct or remove the key. The remedy names the nearest known one.",
    ]),
    notice([
        "settings-unread",
        "A file in the folder of the SKU files is not read.",
        "Settings of a SKU have the name of the SKU and the ending .toml. Other files in this folder have no effect.",
        "Rename the file if it has settings, or move it elsewhere.",
    ]),
    reason([
        "settings-unreadable",
        "A settings file cannot be read.",
        "The file does not exist, may not be read, or is not UTF-8 text.",
        "Check the path and the permissions, and save the file as UTF-8.",
    ]),
    reason([
        "share-missing",
        "A folder of the station was on a share or disk that is not mounted now.",
        "Only the empty mount point is available. Files written there would be hidden as soon as the share is \
         mounted again, so a station waits, and other commands stop.",
        "Mount the share or disk. If the folder is meant to be on the local disk from now on, remove the file \
         that the remedy names.",
    ]),
    reason([
        "sheet-unclear",
        "It is not clear which sheet of the drawing is to be marked.",
        "`space = \"paper\"` under [pattern] reads a sheet in paper space of a DXF. Several sheets have content, or none, or \
         none has the name in the settings. The reason lists the sheets with content.",
        "Name the sheet: `space = \"paper:NAME\"` (`--space paper:NAME`), or set `space = \"model\"`.",
    ]),
    notice([
        "sheet-unit",
        "The sheet in paper space is plotted in another unit than that of the file.",
        "Programs plot a sheet in inches or millimetres, and it is usually drawn in that unit, whatever the unit of the model is. isomark \
         reads it in the unit of the file. The message gives the size in both.",
        "Compare the size with the drawing. If it is wrong, set the unit of the drawing ($INSUNITS) in the CAD program to that of the sheet, and \
         export it again.",
    ]),
    reason([
        "sidecar-late",
        "The settings of a drawing arrived after the drawing was delivered.",
        "A `<name>.toml` beside `<name>.dxf` applies only to a drawing that is processed after it. This drawing \
         was delivered without these settings.",
        "Drop the drawing again. In future, drop the settings before the drawing.",
    ]),
    reason([
        "sidecar-no-file",
        "The settings beside the drawing are a folder or a link.",
        "isomark does not follow links.",
        "Put a file there, or remove it.",
    ]),
    reason([
        "sidecar-settling",
        "The settings beside the drawing may still be written.",
        "The drawing waits until its `<name>.toml` no longer changes.",
        "Nothing: isomark looks at the file again.",
    ]),
    reason([
        "sidecar-too-large",
        "The settings beside the drawing are too large.",
        "A file with a few settings is never this large; it is probably another file with the extension `.toml`.",
        "Write only the settings of this drawing into the file.",
    ]),
    notice([
        "size-implausible",
        "The part's size is implausible.",
        "Its longest side is outside the range of products on a marking table. Usually the unit is wrong.",
        "Set the unit of the file with `unit` under [part] or `--part-unit`.",
    ]),
    notice([
        "size-unconfirmed",
        "The part may be ten times too large.",
        "build123d exports a part ten times too large if its unit is set to CM. The size alone does not show \
         whether this is such a file.",
        "Compare the size with the real part. If it is wrong, export with the unit MM, or set `unit = \"dm\"` \
         under [part].",
    ]),
    notice([
        "size-unusual",
        "The drawing has an unusual size.",
        "It is far smaller or larger than usual marks. Usually the unit is wrong, or a stray entity is far from \
         the drawing.",
        "Check the unit (`unit_if_unitless` under [pattern], `--pattern-unit`) and delete stray entities.",
    ]),
    reason([
        "sku-name",
        "The SKU's name is not valid.",
        "The name becomes a folder and a file name on every system. It must begin with a letter, a digit or `_`, \
         must not contain / \\ : * ? \" < > | @, must not end with a dot or space, and must have at most 100 \
         characters.",
        "Rename the file. The part of the name before `@` (or before the extension) is the SKU.",
    ]),
    reason([
        "sku-unknown",
        "No surface is stored for this SKU under these settings.",
        "`correct --sku` without a part needs a surface that was fitted before with the same part settings (unit, \
         facing, smoothing and others).",
        "Name the part before the drawing. Its surface is stored from then on.",
    ]),
    reason([
        "station-alive",
        "The station is still running, so it keeps the job.",
        "`isomark retry --take-over` is for stations that will not finish what they have taken. This one gave a sign of life in the last 45 s, and may mark the drawing at any moment.",
        "Stop the station, or wait until it is silent. If it is certainly not running, add `--force`.",
    ]),
    reason([
        "station-held",
        "The station is already running.",
        "Another process has the lock in the state folder. The message names the process, if it is known.",
        "Stop that process first. A second station needs its own `hot` and `state` folders.",
    ]),
    reason([
        "station-journal",
        "The station's journal cannot be read or written.",
        "The journal in `folders.state` records which drops were delivered. Without it a drop could be lost or \
         delivered twice, so the station stops.",
        "Let the user that runs the station read and write `folders.state`, and free space on its disk.",
    ]),
    reason([
        "station-lock",
        "The station's lock cannot be taken.",
        "The lock file in `folders.state` cannot be created or locked. Some network shares do not support locks.",
        "Let the user that runs the station write into `folders.state`, and choose a folder on a local disk.",
    ]),
    notice([
        "steep",
        "The beam meets the part at a steep angle.",
        "Under the ink the surface is inclined to the beam by more than `incidence_warn_deg` under [optics]. \
         Marks get paler and wider there. The message gives the place.",
        "Make the drawing narrower, place it where the part faces the laser, or turn the part.",
    ]),
    notice([
        "step-converted",
        "FreeCAD converted the faces of the STEP file.",
        "The laser sees a face on a surface that isomark does not read, and the settings request a conversion. FreeCAD wrote all faces \
         as B-splines: planes, cylinders and other surfaces of STEP exactly, offsets and the like approximately. A cylinder or cone is \
         recognised from its shape, no longer from the numbers of the file.",
        "Compare the size of the part, and mark a test piece. With `converter = \"none\"` under [part] such parts are rejected.",
    ]),
    both([
        "step-face-unread",
        "A face of the STEP file is on a surface that isomark does not read.",
        "isomark computes what the laser meets on the exact surfaces of a STEP file: planes, cylinders, cones, spheres, tori, \
         surfaces of revolution and extrusion, and B-splines. It never leaves out a face silently. A part is rejected only if the \
         laser sees such a face; otherwise a warning names it.",
        "Turn another side to the laser (`--facing`), set `converter = \"freecad\"` under [part] where FreeCAD is installed, or open \
         the file in FreeCAD and export the body as GLB.",
    ]),
    notice([
        "step-files-missing",
        "Components of the STEP assembly are in other files.",
        "Some CAD programs write an assembly as several STEP files: one with the structure, and one for each component. isomark \
         reads one file. The surface that the laser meets is wrong where a missing component covers the part.",
        "Export the assembly as one STEP file, unless the laser does not meet the missing components.",
    ]),
    reason([
        "step-invalid",
        "The STEP file contradicts itself, or uses something that isomark does not read.",
        "A record is missing, of another kind than its use requires, contains itself, or has an invalid number. The message \
         gives the line and the number of the record.",
        "Open the file in FreeCAD and export the body as STEP again, or as GLB.",
    ]),
    notice([
        "step-placement-missing",
        "Components of the STEP assembly have no placement.",
        "The file states that the components belong to an assembly, but not where. They are read in the coordinates in which they \
         were modelled, usually at the origin of the assembly, which may be the wrong place.",
        "Check in the preview that the components are at their places. If not, export the assembly again.",
    ]),
    reason([
        "still-settling",
        "The file may still be written, or other files are processed first.",
        "isomark reads a file when it has not changed for `watch.settle_ms`, or when its writer has closed it.",
        "Nothing: isomark looks at the file again.",
    ]),
    reason([
        "stops-not-shared",
        "The plates were not held against the same stops.",
        "`--stops` finds the lens axis from the shift between plates, which is only the lens's if all plates were at the same place. \
         The measured positions contradict that: plates are turned against each other, their shifts fit no lens axis, or the \
         axis would be outside the field. Or positions were measured on fewer than two plates.",
        "Hold all plates against the same two stops, and measure positions from the same edges; or leave out `--stops`: the lens \
         distances follow without it.",
    ]),
    notice([
        "stretch-remains",
        "Some lengths stay wrong because no map can keep all of them.",
        "The message names the place and the cause. Usually the part is curved in two directions there: a flat drawing \
         cannot lie on such a surface without stretch, and the map distributes it as well as possible. Noise, edges and \
         coarse facets also stretch lines.",
        "Make the drawing smaller, split it into several jobs, or place it where the part is less curved. \
         `aim` under [correction] sets what is kept first.",
    ]),
    both([
        "surface-fit-failed",
        "No surface could be fitted to the part.",
        "The equations of the fit could not be solved for the side that faces the laser: too little of it is smooth, or there is \
         not enough memory.",
        "Export the part with a finer mesh, or mark another side.",
    ]),
    reason([
        "surface-gone",
        "The surface of the SKU was removed from the cache during the job.",
        "Somebody cleared the cache, or another station replaced the surface. The drawing waits while the part is \
         fitted again from the archive.",
        "Wait. If the part is not in the archive any more, drop it again.",
    ]),
    notice([
        "surface-loose",
        "The fitted surface differs notably from the part under the ink.",
        "The distance is above a fifth of `max_residual_mm` under [correction], so the job continues. The message names \
         the place and the cause: noise, a hole or rim, an edge or ridge, coarse facets, or detail finer than the samples.",
        "Follow the remedy in the message if the lengths must be more accurate.",
    ]),
    reason([
        "surface-not-met",
        "The fitted surface differs too much from the part under the drawing.",
        "An edge, a groove or a coarse mesh is under the drawing, and the smooth surface cannot follow it within \
         `max_residual_mm` under [correction].",
        "Place the drawing beside the edge, export a finer mesh, or raise `max_residual_mm` if the error is \
         acceptable.",
    ]),
    reason([
        "surface-unknown",
        "The shape of the part under the drawing is not known well enough for true lengths.",
        "What the facets of a mesh or the noise of a scan leave unknown makes more than a tenth of the length of the drawing \
         uncertain. Usually a scan has too much noise, too few points or outliers, or a mesh is very coarse.",
        "Scan with less noise and more points, or export the part from CAD as STEP, or as glTF with its normals. `isomark inspect` shows \
         what was found.",
    ]),
    notice([
        "svg-clipped",
        "Shapes or lines are cut by clip paths.",
        "A clip path in an SVG drawing hides everything outside it. isomark marks only the visible part. Where a curve is \
         cut, it becomes short straight lines, which are at most 0.0005 mm from it.",
        "Nothing. To keep the exact curves, cut them in the drawing program.",
    ]),
    reason([
        "svg-damaged",
        "The SVG file cannot be read.",
        "The file is not valid XML, has entities that multiply, or is not an SVG drawing. The reason gives the line.",
        "Export the drawing again as plain SVG.",
    ]),
    notice([
        "svg-ground",
        "The white ground of the page is not marked.",
        "Many programs draw a white rectangle over the whole page below everything else. It is the paper and not ink. A frame that \
         is drawn as its stroke is marked. The default anchor is the middle of what is marked, and not that of the page. What a clip path \
         cuts to another shape is a drawing and is marked. It is a warning if something below it was not read.",
        "Nothing. To mark the rectangle, give it another colour.",
    ]),
    notice([
        "svg-off-page",
        "Some of an SVG drawing is beyond its page and is marked.",
        "Programs show only what is on the page. Leftovers beside it are easily overlooked; isomark marks them, and they move the \
         middle of the drawing, which is the default anchor. The notice states how far they reach, and the first of them. What reaches \
         less than 0.1 mm beyond the page is not mentioned.",
        "Delete what must not be marked. If it is part of the drawing, enlarge the page to the drawing (in Inkscape: File > Document \
         Properties > Resize to content).",
    ]),
    notice([
        "svg-pixels",
        "The size of an SVG page depends on the pixels per inch of the program that wrote it.",
        "A pixel of SVG is 1/96 inch. Adobe Illustrator uses 72 pixels per inch, and Inkscape before 0.92 used 90, so the \
         drawing has another size there. The notice gives both sizes.",
        "Check the size. If it is wrong, set `width_mm` under [pattern] (`--width`), or export with the size in mm.",
    ]),
    notice([
        "svg-shades",
        "Shapes have a gradient or pattern as colour.",
        "isomark marks the whole area or the whole line. It does not convert shades to dots (halftone).",
        "Check that the whole area may be marked, or draw the parts that must be marked.",
    ]),
    reason([
        "svg-size",
        "The size of an SVG page cannot be read.",
        "The outermost element has a `width`, `height` or `viewBox` that is not a size, such as `40 furlong` or `calc(4cm)`, or its \
         style limits the size. Without it, the drawing would be marked at another size.",
        "Export the drawing with its width and height in mm.",
    ]),
    notice([
        "svg-strokes",
        "Strokes are marked along their centre lines.",
        "An SVG drawing shows a stroke as a band. A laser usually marks its centre line, so a wide stroke becomes a thin \
         line. The notice names the widest stroke.",
        "Set `strokes = \"band\"` under [pattern] (`--strokes band`) to mark strokes at their full width.",
    ]),
    notice([
        "svg-style",
        "Style sheets in other files are not read.",
        "An SVG drawing refers to a style sheet in another file, often for a font. It may hide, show or change what is marked.",
        "Check the marked lines. If they are not those of the drawing, export it as plain SVG.",
    ]),
    notice([
        "svg-transparent",
        "Shapes are partly transparent.",
        "A laser marks a shape or does not; shapes that are not fully transparent are marked.",
        "Delete the shapes that must not be marked.",
    ]),
    notice([
        "svg-white",
        "White shapes are marked like all others.",
        "On paper, white hides what is below it. A laser cannot do this, so isomark also marks white shapes.",
        "Delete the white shapes, or cut what they cover in the drawing program (Path > Difference).",
    ]),
    reason([
        "takes-long",
        "The job takes longer than a quick attempt may.",
        "isomark first tries small jobs quickly, so that they do not wait for large ones. This job is large and \
         is done without a limit later.",
        "Wait until it is done.",
    ]),
    notice([
        "texts-drawn",
        "Texts were converted to the outlines or strokes of their letters.",
        "The laser marks lines, not texts. The corrected drawing contains the letters as curves.",
        "Check the texts in the preview.",
    ]),
    notice([
        "tiles-as-unused",
        "The tiles of a mark round the part are not written as files, although the settings ask for it.",
        "A station delivers one drawing for each drop, with the tiles as its layers. `isomark check` names the file that sets \
         `as = \"files\"` under [rotary].",
        "Remove the setting. To get files, correct the drawing with `isomark correct --station`.",
    ]),
    reason([
        "too-much-ink",
        "The drawing's lines are too long to be marked.",
        "All lines together are so long that marking would take hours. Usually the unit is wrong, or areas are \
         filled with single lines.",
        "Check the drawing's unit. Draw filled areas as HATCH or as closed outlines and let the marking software \
         fill them.",
    ]),
    reason([
        "too-steep",
        "The beam would meet the part at too steep an angle.",
        "Under the ink the surface is inclined to the beam by more than `incidence_refuse_deg` under [optics]. \
         The reason gives the angle and the place.",
        "Make the drawing narrower, place it where the part faces the laser, or turn the part.",
    ]),
    notice([
        "trailing-bytes",
        "The STL file has bytes after its last facet.",
        "The header states fewer facets than the file could contain. Some programs append their own data. The \
         bytes were ignored.",
        "Nothing to do if the part looks complete.",
    ]),
    notice([
        "transparent-whole",
        "Entities are partly transparent.",
        "A laser marks an entity or does not; entities of a DXF file that are partly transparent are marked like all others.",
        "Delete the entities that must not be marked.",
    ]),
    notice([
        "unit-assumed",
        "The file does not state its unit reliably, so isomark chose one.",
        "The message gives the unit and why it was chosen. If it is a note, the choice is certain or usual; if it is a \
         warning, isomark guessed. A wrong unit makes the part or the drawing much too large or too small.",
        "Check the size with `isomark inspect`. Set `unit` under [part] (`--part-unit`) for a part, \
         `unit_if_unitless` under [pattern] (`--pattern-unit`) for a drawing, or `width_mm` under [pattern] (`--width`) for an SVG \
         without a size.",
    ]),
    notice([
        "unit-pixels",
        "Inkscape wrote the drawing without a unit, so its numbers are probably pixels.",
        "Inkscape exports 96 units per inch when the document's unit is px. Read as mm, the drawing is almost \
         four times too large.",
        "Set `unit_if_unitless = \"px\"` under [pattern] (`--pattern-unit px`), or set the document's unit to mm \
         in Inkscape and export again.",
    ]),
    notice([
        "unit-setting-unused",
        "The drawing states its unit, so the setting for drawings without one is not used.",
        "`unit_if_unitless` applies only to drawings that state no unit.",
        "Nothing to do if the drawing's own unit is right.",
    ]),
    reason([
        "unknown-kind",
        "The file is neither a part nor a drawing.",
        "The hot folder accepts parts, scans, drawings (DXF, SVG) and pictures (PNG, BMP), and the files that belong to \
         them. The extension decides.",
        "Export the part as STEP, GLB, glTF, OBJ, STL, PLY, 3MF or a list of points, and the drawing as DXF or SVG. Save a \
         picture as PNG or BMP and a table as CSV, and unpack an archive.",
    ]),
    reason([
        "usage",
        "The command line is wrong.",
        "An option, a value or a combination of both is not valid, or a required argument is missing. The exit \
         code is 2.",
        "Run `isomark help` or `isomark COMMAND --help`.",
    ]),
    reason([
        "waits-for-part",
        "The drop waits for a part.",
        "A drawing needs the fitted surface of its SKU, and no part of that SKU is known or complete yet; or the fleet knows the part, \
         and its surface has not arrived at this station. A file \
         that belongs to a part, such as a texture or a `.bin`, waits for the part that names it.",
        "Drop the part under the SKU's name. Remove the waiting file if nothing needs it.",
    ]),
    reason([
        "waits-for-pattern",
        "The settings wait for the drawing of the same name.",
        "A `<name>.toml` in the hot folder applies to `<name>.dxf`, which has not arrived.",
        "Drop the drawing, or remove the settings.",
    ]),
    reason([
        "waits-for-turn",
        "The file is complete and waits for other large jobs.",
        "Large jobs are done one after the other, so that small ones are not delayed.",
        "Nothing: it is done after the large jobs before it.",
    ]),
    notice([
        "weights-unused",
        "Weights are set that have no effect.",
        "`aim`, `length_weight` and `angle_weight` under [correction] apply to `weighting = \"ink\"` only.",
        "Remove them, or set `weighting = \"ink\"`.",
    ]),
    notice([
        "white-fills",
        "White fills are marked like all others.",
        "In a DXF file, a fill in the true colour white or in colour 255 stays white on paper, and hides what is drawn before it. A laser \
         cannot do this, so isomark also marks white fills. Colour 7 is black on paper and is not reported.",
        "Delete the white fills, and trim what they cover. If they must be marked, give them another colour.",
    ]),
    notice([
        "wide-lines",
        "Polylines with a width are marked as filled outlines.",
        "The width in the drawing is real ink: the laser marks its outline, and the marking software fills it.",
        "Set the width to 0 in the drawing program if a single line is meant.",
    ]),
    both([
        "winding-contradicts",
        "The part's surface has only one side, like a Möbius strip.",
        "The triangles cannot all be oriented alike, so near the stated place it is not known which side is \
         outside.",
        "Repair the mesh (in Blender: Mesh > Normals > Recalculate Outside), or keep the ink away from that place.",
    ]),
    notice([
        "winding-made-alike",
        "Triangles that ran the opposite way to their neighbours were reversed.",
        "The file has no normals that show the outside, or normals that were computed from the reversed triangles. isomark oriented the triangles like their neighbours, and estimates the normals beside them.",
        "Nothing to do if the part looks right. In Blender, use Recalculate Outside before the export.",
    ]),
    notice([
        "without-length",
        "Pieces of the drawing have no length.",
        "The drawing was read strictly, so they stay. They mark nothing, but can make a laser fire at one spot.",
        "Delete them in the drawing program, or leave out `strict` to let isomark remove them.",
    ]),
];
