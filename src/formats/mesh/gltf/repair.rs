//! Repairs glTF documents that lack entries, or have invalid ones, that do not change the shape.
//!
//! The format crate refuses a whole document for an entry that is not as in the standard. A document that it refuses is
//! read again without such entries.

use ::gltf::json::Root;
use serde_json::{Value, json};

use crate::formats::mesh::MeshReadError;
use crate::reason::Notice;

/// Extensions that a file may require although they are ignored: they change the look, the motion or the description, not
/// the shape (Khronos, glTF extension registry).
const LOOKS_ONLY: [&str; 34] = [
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_techniques_webgl",
    "KHR_technique_webgl",
    "KHR_animation_",
    "KHR_audio",
    "KHR_binary_glTF",
    "KHR_environment_map",
    "KHR_interactivity",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "EXT_texture_",
    "EXT_lights_",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_materials_",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "ADOBE_materials_",
    "AGI_articulations",
    "AGI_stk_metadata",
    "ASOBO_",
    "CESIUM_primitive_outline",
    "FB_geometry_metadata",
    "GRIFFEL_bim_data",
    "MPEG_audio",
    "MPEG_texture_",
    "MSFT_audio",
    "MSFT_lod",
    "MSFT_packing_",
    "MSFT_texture_dds",
    "NV_materials_mdl",
];

/// Whether an extension changes only the look, the motion or the description of a part.
pub(super) fn is_looks_only(extension: &str) -> bool {
    LOOKS_ONLY.iter().any(|known| extension.starts_with(known))
}

/// The notice about required extensions that are ignored.
pub(super) fn looks_notice(required: &[String]) -> Option<Notice> {
    let names: Vec<&str> = required.iter().map(String::as_str).filter(|name| is_looks_only(name)).collect();
    (!names.is_empty()).then(|| {
        let message = format!(
            "the file requires {}, which isomark ignores: they change the look, the motion or the description, not the shape",
            names.join(", ")
        );
        Notice::note("extension-ignored", message)
    })
}

/// Reads a document again that the format crate refused with an error; returns it with what was repaired.
///
/// # Errors
/// The same error, unless the document can be repaired; [`MeshReadError::Version`] for glTF 1.
pub(super) fn reread(text: &str, error: MeshReadError) -> Result<(Root, Vec<Notice>), MeshReadError> {
    let Ok(mut document) = serde_json::from_str::<Value>(text) else { return Err(error) };
    if let Some(version) = first_version(&document) {
        return Err(MeshReadError::Version { version });
    }
    let mut repaired = Vec::new();
    let without_nodes = with_lists_of_nodes(&mut document);
    if without_nodes > 0 {
        repaired.push(format!("{without_nodes} x scene without nodes"));
    }
    let mut replace = |name: &str, count: usize| {
        if count > 0 {
            repaired.push(format!("{count} x invalid {name}"));
        }
    };
    replace("animation", without_invalid("animations", &mut document));
    let material = |old: &Value| json!({"name": old["name"].as_str().unwrap_or_default()});
    replace("material", with_valid("materials", &mut document, material));
    replace("texture", with_valid("textures", &mut document, |_| json!({"source": 0})));
    replace("texture sampler", with_valid("samplers", &mut document, |_| json!({})));
    replace("image", with_valid("images", &mut document, |_| json!({})));
    replace("skin", with_valid("skins", &mut document, |_| json!({"joints": []})));
    let camera = |_: &Value| json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 1}});
    replace("camera", with_valid("cameras", &mut document, camera));
    // Indexing adds an empty entry where there was none.
    if let Some(entries) = document.as_object_mut() {
        entries.retain(|_, value| !value.is_null());
    }
    if repaired.is_empty() {
        return Err(error);
    }
    let root = Root::from_str(&document.to_string()).map_err(|_| error)?;
    let message = format!(
        "the file is not valid glTF, but what is wrong does not change the shape and was ignored: {}",
        repaired.join(", ")
    );
    Ok((root, vec![Notice::warning("gltf-repaired", message)]))
}

/// The version of a document of glTF 1, whose lists are tables by name.
fn first_version(document: &Value) -> Option<String> {
    let version = document["asset"]["version"].as_str().filter(|version| version.starts_with('1'));
    let is_table = ["meshes", "accessors", "nodes"].iter().any(|list| document[*list].is_object());
    version.map(str::to_owned).or_else(|| is_table.then(|| "1.0".to_owned()))
}

/// Adds an empty list of nodes to the scenes without one; returns how many.
fn with_lists_of_nodes(document: &mut Value) -> usize {
    let scenes = document["scenes"].as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut);
    let without = scenes.filter(|scene| !scene.contains_key("nodes"));
    without.map(|scene| scene.insert("nodes".into(), json!([]))).count()
}

/// Whether a document with nothing but this entry in the list can be read. Types of single entries would be compiled once more.
fn is_valid(list: &str, entry: &Value) -> bool {
    let document = json!({"asset": {"version": "2.0"}, list: [entry]});
    Root::from_str(&document.to_string()).is_ok()
}

/// Removes the invalid entries of a list to which nothing refers; returns how many.
fn without_invalid(list: &str, document: &mut Value) -> usize {
    let Some(entries) = document[list].as_array_mut() else { return 0 };
    let all = entries.len();
    entries.retain(|entry| is_valid(list, entry));
    all - entries.len()
}

/// Replaces the invalid entries of a list, whose places others refer to; returns how many.
fn with_valid(list: &str, document: &mut Value, stand_in: impl Fn(&Value) -> Value) -> usize {
    let entries = document[list].as_array_mut().into_iter().flatten();
    entries.filter(|entry| !is_valid(list, entry)).map(|entry| *entry = stand_in(entry)).count()
}
