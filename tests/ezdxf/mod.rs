//! Checks of written drawings with ezdxf.

#![allow(dead_code, reason = "each test uses only some of these functions")]

use std::process::{Command, Stdio};

const JUDGE: &str = r#"
import sys, io, json, tempfile, os
import ezdxf
from ezdxf import bbox
from ezdxf.lldxf.encoding import decode_dxf_unicode as text
path = sys.argv[1]
doc = ezdxf.readfile(path)
auditor = doc.audit()
box = bbox.extents(doc.modelspace(), fast=False)
def points(e):
    if e.dxftype() == 'POINT': return [list(e.dxf.location)[:2]]
    if e.dxftype() == 'LINE': return [list(p)[:2] for p in (e.dxf.start, e.dxf.end)]
    if e.dxftype() == 'LWPOLYLINE': return [[x, y] for x, y in e.get_points('xy')]
    return [list(v.dxf.location)[:2] for v in e.vertices]
print(json.dumps({
    'version': doc.dxfversion, 'units': doc.header.get('$INSUNITS', -1),
    'measurement': doc.header.get('$MEASUREMENT', -1),
    'errors': [e.message for e in auditor.errors], 'fixes': [e.message for e in auditor.fixes],
    'box': [box.extmin.x, box.extmin.y, box.extmax.x, box.extmax.y] if box.has_data else [],
    'header_box': list(doc.header['$EXTMIN'])[:2] + list(doc.header['$EXTMAX'])[:2],
    'layers': {text(l.dxf.name): [l.dxf.color, l.dxf.true_color if l.dxf.hasattr('true_color') else None] for l in doc.layers},
    'entities': [{'type': e.dxftype(), 'layer': text(e.dxf.layer), 'color': e.dxf.color,
        'true_color': e.dxf.true_color if e.dxf.hasattr('true_color') else None,
        'closed': bool(getattr(e, 'is_closed', getattr(e, 'closed', False))), 'points': points(e)}
        for e in doc.modelspace()],
}))
"#;

/// Whether python3 with ezdxf is available; in CI it must be.
pub(crate) fn is_available() -> bool {
    let has_ezdxf = Command::new("python3")
        .args(["-c", "import ezdxf"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_ezdxf {
        assert!(std::env::var("CI").is_err(), "python3 with ezdxf is required in CI");
        eprintln!("SKIPPED: python3 with ezdxf is not installed, the files were not checked");
    }
    has_ezdxf
}

/// What ezdxf reports about the file; `None` if ezdxf is not available.
pub(crate) fn judged(dxf: &[u8]) -> Option<serde_json::Value> {
    if !is_available() {
        return None;
    }
    let mut file = tempfile::Builder::new().suffix(".dxf").tempfile().unwrap();
    std::io::Write::write_all(&mut file, dxf).unwrap();
    let output = Command::new("python3").arg("-c").arg(JUDGE).arg(file.path()).output().unwrap();
    assert!(output.status.success(), "ezdxf refuses: {}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

/// Fails if ezdxf found errors or repaired something.
pub(crate) fn assert_clean(report: &serde_json::Value) {
    assert_eq!(report["errors"], serde_json::json!([]));
    assert_eq!(report["fixes"], serde_json::json!([]));
}
