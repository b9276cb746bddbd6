//! The report as an HTML page: in a real headless Chromium, and as text.
//!
//! `tests/browser/report.py` drives the browser. It reads the mark from the page's data without the viewer, and compares
//! it with the pixels of screenshots.

use std::process::Command;

use isomark::config::{Field, FieldOrigin};
use isomark::report_html::MAX_FRAME;
use isomark::{Correction, Corrector, Drawing, Part, Settings};

/// Names with markup, as a customer's file could have them: valid on Linux, and never a part of the page.
const HOSTILE: &str = "a</script><img src=x onerror=\"window.marked=1\">&amp;'<!--<b>.dxf";

/// A code on the front of an upright can of radius 33 mm, with a field and a depth of focus.
fn can(drawing: &str) -> Correction {
    let part = Part::open("examples/parts/can.glb").unwrap();
    let code = std::fs::read("examples/patterns/code.dxf").unwrap();
    let mut settings = Settings::default().facing("-y").unwrap().place(9.0, 60.0);
    let job = settings.job();
    job.field = Some(Field { width: 110.0, height: 110.0, origin: FieldOrigin::Center });
    job.fixture.y = -60.0;
    job.optics.focus_depth = Some(4.0);
    let surface = Corrector::new().fit(&part, &settings).unwrap();
    surface.correct(&Drawing::from_bytes(drawing, code), &settings).unwrap()
}

fn page(correction: &Correction) -> String {
    String::from_utf8(correction.report_html()).unwrap()
}

/// Size of everything in the page but the panels and the part's data.
fn frame(correction: &Correction, page: &str) -> usize {
    let panels = String::from_utf8(correction.picture()).unwrap();
    let panels = &panels[panels.find("<svg").unwrap()..];
    assert!(page.contains(panels), "the flat panels are in the page as they are");
    page.len() - panels.len() - correction.on_part().len().div_ceil(3) * 4
}

#[test]
fn a_report_works_in_a_real_browser() {
    let Some(axe) = crate::browser::axe() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("can.report.html");
    std::fs::write(&file, can(HOSTILE).report_html()).unwrap();
    let mut command = Command::new("python3");
    command.args(["-B", "tests/browser/report.py"]).arg(axe).arg(&file);
    // `ISOMARK_SCREENSHOTS` names a folder for pictures of what the test saw.
    command.args(std::env::var_os("ISOMARK_SCREENSHOTS"));
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn a_page_names_nothing_outside_itself_and_escapes_all_names() {
    let correction = can(HOSTILE);
    let page = page(&correction);
    // XML names its forms by addresses that no browser opens.
    let text = page.replace("http://www.w3.org/2000/svg", "").replace("http://www.w3.org/1999/xlink", "");
    for outside in ["http:", "https:", "//www", "@import", "url(h", "<link rel=\"stylesheet", "<iframe"] {
        assert!(!text.contains(outside), "{outside}");
    }
    let body = &page[..page.find("<script").unwrap()];
    let mut tags = body.split('<').filter_map(|piece| piece.split_once('>')).map(|(tag, _)| tag);
    // A policy without inline styles also forbids attributes.
    assert!(tags.all(|tag| {
        [" src=", " style=", " onerror", " onclick", " onload"].iter().all(|word| !tag.contains(word))
    }));
    assert!(page.contains(
        "<h1>a&lt;/script&gt;&lt;img src=x onerror=&quot;window.marked=1&quot;&gt;&amp;amp;&#39;&lt;!--"
    ));
    assert!(!text.contains("<img") && !text.contains("<!--") && !text.contains("<b>"));
    assert_eq!(page.matches("</script").count(), 3);
    assert!(page.contains("content=\"default-src 'none'; script-src 'sha256-"));
}

#[test]
fn a_page_is_small_and_the_same_for_the_same_input() {
    let correction = can("code.dxf");
    let first = page(&correction);
    assert!(frame(&correction, &first) <= MAX_FRAME, "{}", frame(&correction, &first));
    assert_eq!(first, page(&can("code.dxf")));
}

#[test]
fn long_lists_and_names_do_not_enlarge_a_page() {
    // A drawing with 3000 entities that are not marked, on layers with long names.
    let layer = |index: usize| format!("{index}-{}", "long&name".repeat(25));
    let mut dxf = String::from("0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n-5\n20\n0\n11\n5\n21\n0\n");
    for index in 0..3000 {
        dxf += &format!("0\nRAY\n5\n{:X}\n8\n{}\n10\n0\n20\n0\n11\n1\n21\n0\n", index + 32, layer(index));
    }
    dxf += "0\nENDSEC\n0\nEOF\n";
    let part = Part::open("examples/parts/mouse.glb").unwrap();
    let settings = Settings::default().place(0.0, 8.0);
    let drawing = Drawing::from_bytes(format!("{}.dxf", "ü".repeat(120)), dxf);
    let correction = Corrector::new().fit(&part, &settings).unwrap().correct(&drawing, &settings).unwrap();
    assert_eq!(correction.report().pattern.facts.skipped.len(), 3000);
    let page = page(&correction);
    assert!(frame(&correction, &page) <= MAX_FRAME, "{}", frame(&correction, &page));
    assert!(page.contains("3000 entities") && page.contains("more: see the report in JSON"));
}

#[test]
fn a_notice_has_its_place_on_the_part() {
    // The can is upright: a point at x on its front has the normal (x, y)/33 mm, and the beam comes from -y.
    let correction = can("code.dxf");
    let report = correction.report();
    let inclined = report.notices.iter().find(|notice| notice.code == "inclined").unwrap();
    let [[x, y, z]] = inclined.places_mm[..] else { panic!("{inclined:?}") };
    assert!((x.hypot(y) - 33.0).abs() < 0.05 && y < 0.0, "({x}, {y})");
    let [view_x, view_y] = report.exposure.incidence_at_mm;
    assert!((x - view_x).abs() < 1e-9 && (z - view_y).abs() < 1e-9);
    assert!(((x.abs() / 33.0).asin().to_degrees() - report.exposure.incidence_deg).abs() < 0.2);
    assert!(page(&correction).contains("data-spot=\"3\">Show place 1<"));
}

#[test]
fn the_page_states_the_values_of_the_report() {
    let correction = can("code.dxf");
    let (report, page) = (correction.report(), page(&correction));
    let before = report.quality.before.as_ref().unwrap();
    for text in [
        "<h1>code.dxf on can</h1>".to_owned(),
        format!(
            "{:.3} <span aria-label=\"becomes\">→</span> </span>{:.3}",
            before.length_error_mm, report.quality.after.length_error_mm
        ),
        format!("{:.1}</span> <span class=\"unit\">°</span>", report.exposure.incidence_deg),
        report.part.origin.blake3.clone(),
        report.pattern.blake3.clone(),
        report.output.blake3.clone(),
        report.program.clone(),
        "id=\"show-field\"".to_owned(),
        "id=\"show-focus\"".to_owned(),
        "from z = ".to_owned(),
    ] {
        assert!(page.contains(&text), "{text}");
    }
}
