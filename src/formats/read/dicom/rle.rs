//! Run-length encoded frames (PS3.5 annex G): a head of 16 numbers, then a run of bytes for each byte of a pixel, the
//! high one first.

/// Bytes of the head.
pub(super) const HEAD_BYTES: usize = 64;

/// Most bytes that an encoded frame of so many can have: one in 128 more for each run, and what pads it.
pub(super) fn most_bytes(frame_bytes: usize) -> u64 {
    (HEAD_BYTES + frame_bytes + frame_bytes / 64 + 1024) as u64
}

/// Decodes a frame of `size` bytes a pixel, 1 or 2, to bytes in which the low one of a pixel is the first; `None`
/// where it has not exactly as many bytes as `out`.
pub(super) fn unpack(encoded: &[u8], size: usize, out: &mut [u8]) -> Option<()> {
    let (head, _) = encoded.split_first_chunk::<HEAD_BYTES>()?;
    let mut numbers = Vec::new();
    for number in head.as_chunks::<4>().0 {
        numbers.push(usize::try_from(u32::from_le_bytes(*number)).ok()?);
    }
    let (count, offsets) = numbers.split_first()?;
    if *count != size || *offsets.first()? < HEAD_BYTES {
        return None;
    }
    for run in 0..size {
        let end = if run + 1 < size { *offsets.get(run + 1)? } else { encoded.len() };
        unpack_run(encoded.get(*offsets.get(run)?..end)?, size - 1 - run, size, out)?;
    }
    Some(())
}

/// Decodes a run to every `step`-th byte of `out` from `place` on.
fn unpack_run(mut encoded: &[u8], place: usize, step: usize, out: &mut [u8]) -> Option<()> {
    let wanted = out.len() / step;
    let mut done = 0;
    while done < wanted {
        let (control, rest) = encoded.split_first()?;
        encoded = rest;
        match *control {
            128 => {}
            literal @ 0..128 => {
                let (bytes, rest) = encoded.split_at_checked(usize::from(literal) + 1)?;
                encoded = rest;
                // Some writers round the run up to an even number.
                for byte in bytes.iter().take(wanted - done) {
                    *out.get_mut(place + step * done)? = *byte;
                    done += 1;
                }
            }
            repeat => {
                let (byte, rest) = encoded.split_first()?;
                encoded = rest;
                let count = (257 - usize::from(repeat)).min(wanted - done);
                if step == 1 {
                    out.get_mut(done..done + count)?.fill(*byte);
                } else {
                    for at in done..done + count {
                        *out.get_mut(place + step * at)? = *byte;
                    }
                }
                done += count;
            }
        }
    }
    // A zero pads it.
    (encoded.len() <= 1).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(runs: &[&[u8]]) -> Vec<u8> {
        let mut numbers = vec![runs.len()];
        let mut at = HEAD_BYTES;
        for run in runs {
            numbers.push(at);
            at += run.len();
        }
        numbers.resize(16, 0);
        let mut bytes: Vec<u8> = numbers.iter().flat_map(|n| u32::try_from(*n).unwrap().to_le_bytes()).collect();
        runs.iter().for_each(|run| bytes.extend(*run));
        bytes
    }

    fn unpacked(runs: &[&[u8]], bytes: usize) -> Option<Vec<u8>> {
        let mut out = vec![0; bytes];
        unpack(&frame(runs), runs.len(), &mut out).map(|()| out)
    }

    #[test]
    fn literals_and_repeats_become_bytes() {
        assert_eq!(unpacked(&[&[1, 7, 8, 254, 9, 128, 0, 5]], 6), Some(vec![7, 8, 9, 9, 9, 5]));
    }

    #[test]
    fn the_high_byte_of_a_pixel_comes_first() {
        assert_eq!(unpacked(&[&[255, 1], &[1, 44, 45]], 4), Some(vec![44, 1, 45, 1]));
    }

    #[test]
    fn a_frame_that_ends_early_or_goes_on_is_refused() {
        for run in [&[1, 7][..], &[254], &[0, 1], &[254, 9, 254, 9, 0, 0]] {
            assert_eq!(unpacked(&[run], 3), None, "{run:?}");
        }
        let mut out = [0; 3];
        let mut reaching = frame(&[&[254, 9]]);
        reaching[4] = 200;
        for damaged in [&frame(&[&[254, 9], &[254, 9]])[..], &frame(&[])[..40], &reaching] {
            assert_eq!(unpack(damaged, 1, &mut out), None);
        }
    }
}
