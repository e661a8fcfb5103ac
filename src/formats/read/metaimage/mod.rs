//! MetaImage → label map.
