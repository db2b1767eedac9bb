//! Safetensors bytes to named f32 tensors, with everything checked that a hostile file could bend.

use crate::{Error, linear::Linear};
use safetensors::{Dtype, SafeTensors};
use std::collections::BTreeMap;

/// Largest header that is accepted, bytes.
const MAX_HEADER: u64 = 1 << 20;

/// Tensors of one file, by name, converted to f32 (indices to i64).
#[derive(Clone, Debug)]
pub struct Store {
    tensors: BTreeMap<String, Tensor>,
    metadata: BTreeMap<String, String>,
}

#[derive(Clone, Debug)]
struct Tensor {
    shape: Vec<usize>,
    data: Data,
}

#[derive(Clone, Debug)]
enum Data {
    Float(Vec<f32>),
    Int(Vec<i64>),
}

impl Store {
    /// Reads a whole file. F16, F32 and I64 tensors are taken.
    ///
    /// # Errors
    /// Headers of more than 1 MiB, other types, bytes that are no safetensors.
    pub fn read(bytes: &[u8]) -> Result<Self, Error> {
        let size = bytes
            .get(..8)
            .and_then(|b| b.try_into().ok())
            .map(u64::from_le_bytes)
            .ok_or_else(|| Error::File("shorter than its 8-byte header length".into()))?;
        if size > MAX_HEADER {
            return Err(Error::File(format!("header of {size} bytes, want at most {MAX_HEADER}")));
        }
        let (_, meta) = SafeTensors::read_metadata(bytes).map_err(|e| Error::File(e.to_string()))?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| Error::File(e.to_string()))?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.tensors() {
            let raw = view.data();
            let data = match view.dtype() {
                Dtype::F32 => {
                    Data::Float(raw.as_chunks::<4>().0.iter().map(|c| f32::from_le_bytes(*c)).collect())
                }
                Dtype::F16 => Data::Float(
                    raw.as_chunks::<2>().0.iter().map(|c| half::f16::from_le_bytes(*c).to_f32()).collect(),
                ),
                Dtype::I64 => {
                    Data::Int(raw.as_chunks::<8>().0.iter().map(|c| i64::from_le_bytes(*c)).collect())
                }
                other => return Err(Error::tensor(&name, format!("type {other:?}, want F16, F32 or I64"))),
            };
            tensors.insert(name, Tensor { shape: view.shape().to_vec(), data });
        }
        let metadata = meta.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        Ok(Self { tensors, metadata })
    }

    /// A metadata string.
    #[must_use]
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    /// Names in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// Whether a tensor is there.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// Shape and values of a float tensor, values unchecked.
    ///
    /// # Errors
    /// Missing, or not of a float type.
    pub fn floats(&self, name: &str) -> Result<(&[usize], &[f32]), Error> {
        let t = self.get(name)?;
        match &t.data {
            Data::Float(v) => Ok((&t.shape, v)),
            Data::Int(_) => Err(Error::tensor(name, "holds integers, want F16 or F32")),
        }
    }

    /// Shape and values of an integer tensor.
    ///
    /// # Errors
    /// Missing, or not I64.
    pub fn ints(&self, name: &str) -> Result<(&[usize], &[i64]), Error> {
        let t = self.get(name)?;
        match &t.data {
            Data::Int(v) => Ok((&t.shape, v)),
            Data::Float(_) => Err(Error::tensor(name, "holds floats, want I64")),
        }
    }

    fn get(&self, name: &str) -> Result<&Tensor, Error> {
        self.tensors.get(name).ok_or_else(|| Error::tensor(name, "is missing"))
    }

    fn finite(&self, name: &str) -> Result<(&[usize], &[f32]), Error> {
        let (shape, v) = self.floats(name)?;
        if let Some(i) = v.iter().position(|x| !x.is_finite()) {
            return Err(Error::tensor(name, format!("value {i} is {}, want finite numbers", v[i])));
        }
        Ok((shape, v))
    }

    /// The layer `<prefix>.weight` [out, in] (a trailing 1 is dropped) and `<prefix>.bias` [out].
    pub(crate) fn linear(&self, prefix: &str) -> Result<Linear, Error> {
        let name = format!("{prefix}.weight");
        let (shape, w) = self.finite(&name)?;
        let (out, inp) = match *shape {
            [o, i] | [o, i, 1] if o > 0 && i > 0 => (o, i),
            _ => return Err(Error::tensor(&name, format!("shape {shape:?}, want [out, in]"))),
        };
        let bias = self.vector(&format!("{prefix}.bias"), out)?;
        Ok(Linear::new(w.to_vec(), bias, inp))
    }

    /// As [`Self::linear`], its input width checked.
    pub(crate) fn linear_from(&self, prefix: &str, inp: usize) -> Result<Linear, Error> {
        let l = self.linear(prefix)?;
        if l.inputs() != inp {
            return Err(Error::tensor(
                &format!("{prefix}.weight"),
                format!("takes {} inputs, the layer before gives {inp}", l.inputs()),
            ));
        }
        Ok(l)
    }

    /// A vector of a given length.
    pub(crate) fn vector(&self, name: &str, len: usize) -> Result<Vec<f32>, Error> {
        let (shape, v) = self.finite(name)?;
        if shape != [len] {
            return Err(Error::tensor(name, format!("shape {shape:?}, want [{len}]")));
        }
        Ok(v.to_vec())
    }
}
