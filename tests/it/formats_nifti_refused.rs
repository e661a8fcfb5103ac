//! What the NIfTI reader refuses, one literal input per case.

use std::io::Read;

use medialrep::formats::{InputLimits, ReadError, read};
use medialrep::problem::Problem;

use crate::help::nifti_bytes::{Nifti, gzip};
use crate::help::reading::Counting;

fn refusal(bytes: &[u8]) -> Problem {
    Problem::from(&read(bytes, InputLimits::default()).unwrap_err())
}

fn check_refused(what: &str, bytes: &[u8], code: &str, status: u16, location: &str) {
    let problem = refusal(bytes);
    assert_eq!((problem.code.as_str(), problem.status), (code, status), "{what}: {}", problem.detail);
    assert_eq!(problem.location.as_deref(), Some(location), "{what}");
    assert!(problem.hint.is_some_and(|hint| !hint.is_empty()), "{what}");
}

fn check_header(what: &str, change: impl Fn(&mut Nifti), code: &str, status: u16, location: &str) {
    let mut file = Nifti::small(1);
    change(&mut file);
    check_refused(what, &file.bytes(), code, status, location);
}

#[test]
fn what_is_no_nifti() {
    check_refused("nothing", b"", "not_nifti", 415, "byte 0");
    check_refused("text", b"hello, this is not a NIfTI", "not_nifti", 415, "byte 0");
    check_refused("zeros", &[0; 4096], "not_nifti", 415, "byte 0");
    check_refused("gzip within gzip", &gzip(&gzip(&Nifti::small(1).bytes())), "not_nifti", 415, "byte 0");
    check_refused("gzip of nothing", &gzip(b""), "not_nifti", 415, "byte 0");
    check_header("Analyze", |f| f.magic = vec![0; 4], "not_nifti", 415, "byte 0");
    check_header("a pair", |f| f.magic = b"ni1\0".to_vec(), "two_file_nifti", 415, "header.magic");
    let mgz: Vec<u8> = [1, 8, 8, 8, 1, 0, 0_i32].iter().flat_map(|n| n.to_be_bytes()).chain([0; 800]).collect();
    let lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:0123\nsize 15203\n";
    for (bytes, look) in [
        (gzip(&mgz), "FreeSurfer"),
        (lfs.to_vec(), "Git LFS"),
        (b"<!DOCTYPE html>\n<html><head><title>Sign in".to_vec(), "web page"),
        (b"<?xml version=\"1.0\"?><Error><Code>AccessDenied".to_vec(), "error message"),
        (b"Not found\n".to_vec(), "plain text"),
        (b"".to_vec(), "empty file"),
        (gzip(b""), "empty file"),
        (vec![0; 4096], "zeros"),
    ] {
        let problem = refusal(&bytes);
        assert!(problem.code == "not_nifti" && problem.detail.contains(look), "{look}: {}", problem.detail);
    }
    let pair = Nifti { magic: b"ni2\0\r\n\x1a\n".to_vec(), ..Nifti::small(2) };
    check_refused("a NIfTI-2 pair", &pair.bytes(), "two_file_nifti", 415, "header.magic");
}

#[test]
fn dimensions() {
    for (what, axis, value) in [("no rank", 0, 0), ("rank 8", 0, 8), ("−3", 1, -3), ("0", 2, 0), ("−1", 3, -1)] {
        check_header(what, |f| f.dim[axis] = value, "bad_dimensions", 400, &format!("header.dim[{axis}]"));
    }
    check_header("rank −3", |f| f.dim[0] = -3, "bad_dimensions", 400, "header.dim[0]");
    check_header("dim[4] −2", |f| (f.dim[0], f.dim[4]) = (4, -2), "bad_dimensions", 400, "header.dim[4]");
    check_header("huge", |f| f.dim = [3, 32767, 32767, 32767, 1, 1, 1, 1], "too_many_voxels", 413, "header.dim");
    let absurd = Nifti { dim: [3, i64::MAX, 2, 2, 1, 1, 1, 1], ..Nifti::small(2) };
    check_refused("2^63", &absurd.bytes(), "bad_dimensions", 400, "header.dim[1]");
    let large = Nifti { dim: [3, 1 << 31, 1 << 31, 1 << 31, 1, 1, 1, 1], ..Nifti::small(2) };
    check_refused("2^93", &large.bytes(), "too_many_voxels", 413, "header.dim");
    for axis in [4, 5, 7] {
        let series = |f: &mut Nifti| {
            f.dim = [7, 4, 3, 2, 1, 1, 1, 1];
            f.dim[axis] = 3;
        };
        check_header("a series", series, "several_volumes", 422, &format!("header.dim[{axis}]"));
    }
}

#[test]
fn datatypes() {
    for (datatype, bitpix) in [(1, 1), (32, 64), (128, 24), (1536, 128), (1792, 128), (2048, 256), (2304, 32), (77, 8)]
    {
        let change = |f: &mut Nifti| (f.datatype, f.bitpix) = (datatype, bitpix);
        check_header("datatype", change, "unsupported_datatype", 422, "header.datatype");
    }
    assert!(refusal(&Nifti { datatype: 128, ..Nifti::small(1) }.bytes()).detail.contains("RGB"));
    check_header("bitpix", |f| f.bitpix = 16, "bad_header_field", 400, "header.bitpix");
    check_header("bitpix −8", |f| f.bitpix = -8, "bad_header_field", 400, "header.bitpix");
}

#[test]
fn other_header_fields() {
    for offset in [f64::NAN, f64::INFINITY, 1e30, -352.0, 351.0, 352.5, 16_777_218.0] {
        check_header("vox_offset", |f| f.vox_offset = offset, "bad_header_field", 400, "header.vox_offset");
    }
    check_header("slope", |f| f.scl_slope = f64::INFINITY, "bad_header_field", 400, "header.scl_slope");
    let inter = |f: &mut Nifti| (f.scl_slope, f.scl_inter) = (2.0, f64::NAN);
    check_header("intercept", inter, "bad_header_field", 400, "header.scl_inter");
}

#[test]
fn orientations() {
    check_header("NaN", |f| f.srow[1][1] = f64::NAN, "bad_affine", 422, "header.srow_x");
    check_header("infinite", |f| f.srow[2][3] = f64::INFINITY, "bad_affine", 422, "header.srow_x");
    check_header("flat", |f| f.srow[2] = [0.0; 4], "bad_affine", 422, "header.srow_x");
    let parallel = |f: &mut Nifti| (f.srow[0], f.srow[1]) = ([1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]);
    check_header("parallel axes", parallel, "bad_affine", 422, "header.srow_x");
    check_header("kilometres", |f| f.srow[0][0] = 1e6, "bad_affine", 422, "header.srow_x");
    let quaternion = |f: &mut Nifti| (f.sform_code, f.qform_code, f.quatern) = (0, 1, [1.0, 0.5, 0.0]);
    check_header("no rotation", quaternion, "bad_affine", 422, "header.quatern_b");
    let nan = |f: &mut Nifti| (f.sform_code, f.qform_code, f.quatern) = (0, 1, [f64::NAN, 0.0, 0.0]);
    check_header("NaN quaternion", nan, "bad_affine", 422, "header.quatern_b");
    for spacing in [0.0, f64::NAN, 1e9] {
        let change = |f: &mut Nifti| (f.sform_code, f.pixdim[2]) = (0, spacing);
        check_header("pixdim", change, "bad_affine", 422, "header.pixdim[2]");
    }
}

#[test]
fn voxels() {
    let reals = |value: f32| {
        let voxels = [1.0, value].iter().cycle().take(24).flat_map(|x| x.to_le_bytes()).collect();
        Nifti { datatype: 16, bitpix: 32, voxels, ..Nifti::small(1) }.bytes()
    };
    for value in [0.37, 1.002, f32::INFINITY, f32::MAX] {
        check_refused("a probability", &reals(value), "not_a_label_map", 422, "voxel [1, 0, 0]");
    }
    for scl_slope in [1.0 / 255.0, 0.3, 0.499, 0.9, 2.5] {
        let scaled = Nifti { scl_slope, voxels: (0..24).collect(), ..Nifti::small(1) };
        let problem = refusal(&scaled.bytes());
        assert!(problem.code == "not_a_label_map" && problem.hint.unwrap().contains("scl_slope"), "slope {scl_slope}");
    }
    let huge = Nifti { datatype: 1280, bitpix: 64, voxels: vec![255; 192], ..Nifti::small(1) };
    check_refused("beyond int64", &huge.bytes(), "not_a_label_map", 422, "voxel [0, 0, 0]");
    let voxels = (0..70_000_u32).flat_map(u32::to_le_bytes).collect();
    let many = Nifti { datatype: 768, bitpix: 32, dim: [3, 700, 100, 1, 1, 1, 1, 1], voxels, ..Nifti::small(1) };
    check_refused("an intensity image", &many.bytes(), "too_many_labels", 422, "the voxels");
}

#[test]
fn damaged_files() {
    let bytes = Nifti::small(1).bytes();
    for kept in [4, 100, 347, 350, 352, 370, 375] {
        check_refused("cut", &bytes[..kept], "truncated", 400, &format!("byte {kept}"));
    }
    let bytes_2 = Nifti::small(2).bytes();
    check_refused("cut in a long header", &bytes_2[..500], "truncated", 400, "byte 500");
    let packed = gzip(&bytes);
    for kept in [2, 12, packed.len() / 2, packed.len() - 8, packed.len() - 1] {
        assert_eq!(refusal(&packed[..kept]).code, "truncated", "{kept} bytes of gzip");
    }
    let mut wrong_checksum = packed.clone();
    let at = wrong_checksum.len() - 8;
    wrong_checksum[at] ^= 1;
    check_refused("wrong CRC", &wrong_checksum, "bad_checksum", 400, "the gzip trailer");
    let mut corrupt = packed.clone();
    corrupt[12] = 0xff;
    corrupt[13] = 0xff;
    assert!(["corrupt_gzip", "truncated", "bad_checksum", "not_nifti"].contains(&refusal(&corrupt).code.as_str()));
    let mut garbage = gzip(&bytes[..360]);
    garbage.extend(b"garbage");
    check_refused("half of the voxels, then garbage", &garbage, "corrupt_gzip", 400, "byte 360");
    let mut second = packed.clone();
    second.extend(&packed[..packed.len() - 12]);
    assert_eq!(refusal(&second).code, "truncated");
}

#[test]
fn real_numbers_in_the_other_byte_order_are_told() {
    let reals = |bits: i16, value: f64, big_endian: bool| {
        #[allow(clippy::cast_possible_truncation, reason = "the value is small")]
        let mut bytes = if bits == 32 { (value as f32).to_le_bytes().to_vec() } else { value.to_le_bytes().to_vec() };
        if big_endian {
            bytes.reverse();
        }
        let voxels = [vec![0; bytes.len()], bytes].concat().repeat(12);
        Nifti { datatype: if bits == 32 { 16 } else { 64 }, bitpix: bits, voxels, ..Nifti::small(1) }
    };
    for bits in [32, 64] {
        for value in [1.0, 2.0, 127.0, 2101.0] {
            for big_endian in [false, true] {
                let file = Nifti { big_endian, ..reals(bits, value, !big_endian) };
                check_refused("swapped", &file.bytes(), "wrong_byte_order", 400, "voxel [1, 0, 0]");
                assert!(refusal(&file.bytes()).detail.ends_with(&format!("{value} in the other")));
            }
        }
    }
    check_refused("all but nothing", &reals(32, 3e-4, false).bytes(), "not_a_label_map", 422, "voxel [1, 0, 0]");
}

#[test]
fn a_megabyte_may_follow_the_voxels_and_no_more() {
    let with_tail = |bytes: usize| {
        let mut file = Nifti::small(1).bytes();
        file.extend(vec![7; bytes]);
        file
    };
    for (what, file) in [("plain", with_tail(1 << 20)), ("gzip", gzip(&with_tail(1 << 20)))] {
        assert!(read(file.as_slice(), InputLimits::default()).is_ok(), "{what}");
    }
    let mut after_gzip = gzip(&with_tail(0));
    after_gzip.extend(vec![7; (1 << 20) + 1]);
    for file in [with_tail((1 << 20) + 1), gzip(&with_tail((1 << 20) + 1)), after_gzip] {
        check_refused("a long tail", &file, "trailing_data", 400, "byte 376");
    }
}

#[test]
fn a_bomb_is_left_unread() {
    // 64 MiB of zeros: as a tail, and as voxels beyond the limit.
    let mut tail = Nifti::small(1).bytes();
    tail.resize(64 << 20, 0);
    let packed = gzip(&tail);
    let mut taken = 0;
    let error = read(Counting(&packed, &mut taken), InputLimits::default()).unwrap_err();
    assert_eq!(error.code(), "trailing_data");
    assert!(taken < packed.len() / 2, "{taken} of {} bytes were read", packed.len());

    let dims = Nifti { dim: [3, 1024, 1024, 64, 1, 1, 1, 1], voxels: vec![0; 64 << 20], ..Nifti::small(1) };
    let limits = InputLimits { max_decompressed_bytes: 1 << 20, ..InputLimits::default() };
    let error = read(gzip(&dims.bytes()).as_slice(), limits).unwrap_err();
    assert!(matches!(error, ReadError::DecompressedTooLarge { limit: 1_048_576 }), "{error}");
    let limits = InputLimits { max_voxels: 1000, ..InputLimits::default() };
    assert_eq!(read(dims.bytes().as_slice(), limits).unwrap_err().code(), "too_many_voxels");
}

#[test]
fn no_text_of_the_header_is_repeated() {
    let mut bytes = Nifti { datatype: 128, ..Nifti::small(1) }.bytes();
    // data_type, db_name, descrip, aux_file, intent_name.
    for (start, end) in [(4, 14), (14, 32), (148, 228), (228, 252), (328, 344)] {
        bytes[start..end].fill(b'X');
    }
    let problem = serde_json::to_string(&refusal(&bytes)).unwrap();
    assert!(!problem.contains("XX"), "{problem}");
}

#[test]
fn a_source_that_fails_is_our_fault_and_says_nothing() {
    struct Failing;
    impl Read for Failing {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Err(std::io::Error::other("secret path"))
        }
    }
    let problem = Problem::from(&read(Failing, InputLimits::default()).unwrap_err());
    assert_eq!((problem.status, problem.code.as_str()), (500, "internal"));
    assert!(!problem.detail.contains("secret"));
}
