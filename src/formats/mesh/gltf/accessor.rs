//! Numbers from glTF buffers: everything an accessor refers to is checked here, then the format crate reads it.
//!
//! The crate panics on references to missing entries, on unexpected types and on strides smaller than an element. It
//! returns nothing if data extend beyond their buffer, and skips sparse values whose indices do not increase.

use std::borrow::Cow;

use ::gltf::Document;
use ::gltf::accessor::util::{Item, ItemIter, Iter};
use ::gltf::json::accessor::{Accessor, ComponentType, Type, sparse::Sparse};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, buffer::View};

use crate::formats::mesh::{MAX_TRIANGLES, MeshReadError, at_most};

/// The extension that allows whole numbers as positions and normals.
pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";

/// The JSON and its buffers.
pub(super) struct Data<'a> {
    pub(super) document: &'a Document,
    pub(super) buffers: &'a [Cow<'a, [u8]>],
}

impl Data<'_> {
    /// The bytes of a buffer view.
    pub(super) fn view(&self, view: Index<View>, item: &dyn Fn() -> String) -> Result<&[u8], MeshReadError> {
        let length =
            self.document.as_json().buffer_views.get(view.value()).map_or(0, |view| view.byte_length.0);
        self.bytes(view, 0, length, 1, item).map(|(bytes, _)| bytes)
    }

    /// Triples of floats, such as positions; quantised whole numbers are converted; `item` names their use for error messages.
    pub(super) fn vectors(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<[f32; 3]>, MeshReadError> {
        let kind = self.kind(index, item)?;
        if let (Some(ComponentType::F32), Some(Type::Vec3)) = kind {
            return self.values(index, item);
        }
        let root = self.document.as_json();
        let is_quantized =
            root.extensions_used.iter().chain(&root.extensions_required).any(|name| name == QUANTIZATION);
        let (Some(component), Some(Type::Vec3), true) = (kind.0, kind.1, is_quantized) else {
            return Err(wrong_data(item, "three 32-bit floats", kind));
        };
        let largest = if self.json(index, item)?.normalized { largest(component) } else { 1.0 };
        // Signed numbers have one more negative value, which stands for -1 as well.
        let scaled = |value: f32| if largest > 1.0 { (value / largest).max(-1.0) } else { value };
        match component {
            ComponentType::I8 => self.values::<[i8; 3]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U8 => self.values::<[u8; 3]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::I16 => self.values::<[i16; 3]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U16 => self.values::<[u16; 3]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U32 | ComponentType::F32 => Err(wrong_data(item, "three 32-bit floats", kind)),
        }
    }

    /// Quadruples of floats between -1 and 1, such as quaternions and weights, also as whole numbers that stand for them.
    pub(super) fn quadruples(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<[f32; 4]>, MeshReadError> {
        let kind = self.kind(index, item)?;
        let (Some(component), Some(Type::Vec4)) = kind else {
            return Err(wrong_data(item, "four 32-bit floats", kind));
        };
        let scaled = |value: f32| (value / largest(component)).max(-1.0);
        match component {
            ComponentType::F32 => self.values(index, item),
            ComponentType::I8 => self.values::<[i8; 4]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U8 => self.values::<[u8; 4]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::I16 => self.values::<[i16; 4]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U16 => self.values::<[u16; 4]>(index, item).map(|all| floats(all, scaled)),
            ComponentType::U32 => Err(wrong_data(item, "four 32-bit floats", kind)),
        }
    }

    /// Quadruples of numbers of joints.
    pub(super) fn joints(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<[u16; 4]>, MeshReadError> {
        match self.kind(index, item)? {
            (Some(ComponentType::U8), Some(Type::Vec4)) => {
                let narrow = self.values::<[u8; 4]>(index, item)?;
                Ok(narrow.into_iter().map(|joints| joints.map(u16::from)).collect())
            }
            (Some(ComponentType::U16), Some(Type::Vec4)) => self.values(index, item),
            kind => Err(wrong_data(item, "four unsigned whole numbers of 8 or 16 bits", kind)),
        }
    }

    /// The number of elements of an accessor that has no data, neither a view nor sparse values: all of them are zero. `None` if it has
    /// data.
    pub(super) fn zeros(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Option<u64>, MeshReadError> {
        let json = self.json(index, item)?;
        Ok((json.buffer_view.is_none() && json.sparse.is_none()).then_some(json.count.0))
    }

    /// Matrices by their columns.
    pub(super) fn matrices(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<[[f32; 4]; 4]>, MeshReadError> {
        match self.kind(index, item)? {
            (Some(ComponentType::F32), Some(Type::Mat4)) => self.values(index, item),
            kind => Err(wrong_data(item, "4 x 4 matrices of 32-bit floats", kind)),
        }
    }

    /// Unsigned whole numbers, such as vertex indices.
    pub(super) fn indices(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<u32>, MeshReadError> {
        match self.kind(index, item)? {
            (Some(ComponentType::U8), Some(Type::Scalar)) => self.values::<u8>(index, item).map(widened),
            (Some(ComponentType::U16), Some(Type::Scalar)) => self.values::<u16>(index, item).map(widened),
            (Some(ComponentType::U32), Some(Type::Scalar)) => self.values(index, item),
            kind => Err(wrong_data(item, "unsigned whole numbers", kind)),
        }
    }

    /// All values of an accessor whose elements are of type `T`.
    fn values<T: Item>(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<T>, MeshReadError> {
        let no_data = || MeshReadError::NoData { item: item() };
        let json = self.json(index, item)?;
        let count = json.count.0;
        self.check(json, size_of::<T>(), item)?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let accessor = self.document.accessors().nth(index.value()).ok_or_else(no_data)?;
        let bytes = |buffer: ::gltf::Buffer<'_>| self.buffers.get(buffer.index()).map(|bytes| &**bytes);
        let values: Vec<T> = Iter::new(accessor, bytes).ok_or_else(no_data)?.collect();
        if values.len() as u64 == count { Ok(values) } else { Err(no_data()) }
    }

    /// Refuses data on which the crate would panic, or which it would skip.
    fn check(
        &self,
        accessor: &Accessor,
        size: usize,
        item: &dyn Fn() -> String,
    ) -> Result<(), MeshReadError> {
        let count = accessor.count.0;
        match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                self.bytes(view, offset, count, size, item)?;
            }
            // Without a view all values are zero, which makes sense only together with sparse values.
            None if accessor.sparse.is_none() => return Err(MeshReadError::NoData { item: item() }),
            None => {
                let longest = self.buffers.iter().map(|buffer| buffer.len() as u64).max().unwrap_or(0);
                // Zeros take no bytes in the file; more of them than the buffers have bytes indicate damage.
                if count > longest {
                    return Err(MeshReadError::DataBeyondBuffer {
                        item: item(),
                        needed: count,
                        available: longest,
                    });
                }
            }
        }
        at_most("elements in one accessor", count as usize, 3 * MAX_TRIANGLES)?;
        accessor.sparse.as_ref().map_or(Ok(()), |sparse| self.check_sparse(sparse, count, size, item))
    }

    fn check_sparse(
        &self,
        sparse: &Sparse,
        elements: u64,
        size: usize,
        item: &dyn Fn() -> String,
    ) -> Result<(), MeshReadError> {
        let (places, count) = (&sparse.indices, sparse.count.0);
        self.bytes(sparse.values.buffer_view, sparse.values.byte_offset.0, count, size, item)?;
        let Checked::Valid(kind) = &places.component_type else {
            return Err(wrong_data(item, "unsigned sparse indices", (None, None)));
        };
        let size = kind.0.size();
        let (bytes, stride) = self.bytes(places.buffer_view, places.byte_offset.0, count, size, item)?;
        let places: Vec<u32> = match kind.0 {
            ComponentType::U8 => ItemIter::<u8>::new(bytes, stride).map(u32::from).collect(),
            ComponentType::U16 => ItemIter::<u16>::new(bytes, stride).map(u32::from).collect(),
            _ => ItemIter::<u32>::new(bytes, stride).collect(),
        };
        if let Some(&beyond) = places.iter().find(|place| u64::from(**place) >= elements) {
            return Err(MeshReadError::BrokenReference {
                item: item(),
                kind: "sparse element",
                index: beyond as usize,
                count: elements as usize,
            });
        }
        if !places.is_sorted_by(|one, next| one < next) {
            return Err(MeshReadError::WrongData {
                item: item(),
                expected: "sparse values with increasing indices",
                found: "sparse values with unsorted indices".into(),
            });
        }
        Ok(())
    }

    /// The bytes of `count` elements of `size` bytes each, from `offset` bytes into a view, and their stride in bytes.
    fn bytes(
        &self,
        view: Index<View>,
        offset: u64,
        count: u64,
        size: usize,
        item: &dyn Fn() -> String,
    ) -> Result<(&[u8], usize), MeshReadError> {
        let views = &self.document.as_json().buffer_views;
        let broken = |kind, index, count| MeshReadError::BrokenReference { item: item(), kind, index, count };
        let view = views.get(view.value()).ok_or_else(|| broken("buffer view", view.value(), views.len()))?;
        let buffer = self
            .buffers
            .get(view.buffer.value())
            .ok_or_else(|| broken("buffer", view.buffer.value(), self.buffers.len()))?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let end = start.saturating_add(view.byte_length.0);
        let beyond = |needed, available| MeshReadError::DataBeyondBuffer { item: item(), needed, available };
        let bytes = slice(buffer, start, end).ok_or_else(|| beyond(end, buffer.len() as u64))?;

        // A stride of zero means none, also for the crate.
        let stride = view.byte_stride.map_or(0, |stride| stride.0);
        let stride = if stride == 0 { size } else { stride };
        if stride < size {
            return Err(MeshReadError::WrongData {
                item: item(),
                expected: "elements that do not overlap",
                found: format!("elements of {size} bytes, {stride} bytes apart"),
            });
        }
        // The last element may end before a full stride.
        let span = count.saturating_sub(1).saturating_mul(stride as u64).saturating_add(size as u64);
        let end = if count == 0 { offset } else { offset.saturating_add(span) };
        let bytes = slice(bytes, offset, end).ok_or_else(|| beyond(end, bytes.len() as u64))?;
        Ok((bytes, stride))
    }

    fn json(&self, index: Index<Accessor>, item: &dyn Fn() -> String) -> Result<&Accessor, MeshReadError> {
        let accessors = &self.document.as_json().accessors;
        accessors.get(index.value()).ok_or_else(|| MeshReadError::BrokenReference {
            item: item(),
            kind: "accessor",
            index: index.value(),
            count: accessors.len(),
        })
    }

    fn kind(&self, index: Index<Accessor>, item: &dyn Fn() -> String) -> Result<Kind, MeshReadError> {
        let accessor = self.json(index, item)?;
        let component = match &accessor.component_type {
            Checked::Valid(component) => Some(component.0),
            Checked::Invalid => None,
        };
        let shape = match accessor.type_ {
            Checked::Valid(shape) => Some(shape),
            Checked::Invalid => None,
        };
        Ok((component, shape))
    }
}

/// Component type and shape of an accessor's elements; `None` if the file's word for it is unknown.
type Kind = (Option<ComponentType>, Option<Type>);

/// The number that stands for 1 where values are normalised.
fn largest(component: ComponentType) -> f32 {
    match component {
        ComponentType::I8 => 127.0,
        ComponentType::U8 => 255.0,
        ComponentType::I16 => 32_767.0,
        ComponentType::U16 => 65_535.0,
        ComponentType::U32 | ComponentType::F32 => 1.0,
    }
}

fn floats<T: Into<f32> + Copy, const N: usize>(
    all: Vec<[T; N]>,
    scaled: impl Fn(f32) -> f32,
) -> Vec<[f32; N]> {
    all.into_iter().map(|values| values.map(|value| scaled(value.into()))).collect()
}

fn widened<T: Into<u32>>(narrow: Vec<T>) -> Vec<u32> {
    narrow.into_iter().map(Into::into).collect()
}

fn slice(bytes: &[u8], start: u64, end: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
}

fn wrong_data(item: &dyn Fn() -> String, expected: &'static str, (component, shape): Kind) -> MeshReadError {
    let name = |known: Option<String>| known.unwrap_or_else(|| "an unknown type".into());
    let component = name(component.map(|component| format!("{component:?}").to_lowercase()));
    let shape = name(shape.map(|shape| format!("{shape:?}").to_lowercase()));
    MeshReadError::WrongData { item: item(), expected, found: format!("{shape} of {component}") }
}
