//! How the values of a volume are stored, whatever the format.

/// Which byte of a number comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    /// The number in four bytes.
    pub fn int32(self, bytes: [u8; 4]) -> i32 {
        match self {
            Self::Little => i32::from_le_bytes(bytes),
            Self::Big => i32::from_be_bytes(bytes),
        }
    }
}

/// What a stored value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Datatype {
    Uint8,
    Int8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
}

impl Datatype {
    /// Whether stored values are whole numbers.
    pub fn is_whole(self) -> bool {
        !matches!(self, Self::Float32 | Self::Float64)
    }

    /// Bytes of a value.
    pub fn bytes(self) -> usize {
        match self {
            Self::Uint8 | Self::Int8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Int64 | Self::Uint64 | Self::Float64 => 8,
        }
    }
}

/// How values are written into the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    /// As they are.
    Raw,
    /// Gzip or zlib.
    Deflated,
    /// As decimal numbers.
    Text,
}

/// Stored values to labels: value = slope · stored + intercept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scaling {
    pub slope: f64,
    pub intercept: f64,
}

impl Scaling {
    /// The value that a stored one stands for.
    pub fn value(self, stored: f64) -> f64 {
        stored * self.slope + self.intercept
    }
}

/// Label maps of one volume in one file: where segments overlap there are several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layers {
    /// At least one.
    pub count: usize,
    /// Whether the values of a voxel follow each other; else one label map follows the other.
    pub are_interleaved: bool,
}

impl Layers {
    /// A single label map.
    pub const ONE: Self = Self { count: 1, are_interleaved: false };
}

/// The values of a volume, checked against what is allowed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stored {
    pub dims: [usize; 3],
    /// The product of `dims`.
    pub voxels: usize,
    pub datatype: Datatype,
    pub order: ByteOrder,
    pub scaling: Option<Scaling>,
    pub layers: Layers,
}

impl Stored {
    /// Values of all layers.
    pub fn values(&self) -> usize {
        self.voxels.saturating_mul(self.layers.count)
    }

    /// Bytes of all values, unpacked.
    pub fn bytes(&self) -> u64 {
        (self.values() as u64).saturating_mul(self.datatype.bytes() as u64)
    }

    /// The voxel of the value with this place in the file.
    pub fn voxel(&self, place: usize) -> [u64; 3] {
        self.voxel_at(if self.layers.are_interleaved { place / self.layers.count } else { place % self.voxels })
    }

    /// The voxel with this place in a layer.
    pub fn voxel_at(&self, offset: usize) -> [u64; 3] {
        let [nx, ny, _] = self.dims;
        [offset % nx, offset / nx % ny, offset / (nx * ny)].map(|n| n as u64)
    }
}

/// The product of three lengths, if it is allowed and can be counted here; else what it is.
pub(super) fn voxels_of(dims: [usize; 3], max_voxels: u64) -> Result<usize, u128> {
    let mut product: u128 = 1;
    for length in dims {
        product = product.saturating_mul(length as u128);
    }
    if product > u128::from(max_voxels) {
        return Err(product);
    }
    usize::try_from(product).map_err(|_| product)
}
