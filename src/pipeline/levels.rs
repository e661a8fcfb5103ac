//! Whether a volume is a label map at all: an image of intensities saved as whole numbers has a label for every grey.

use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::pipeline::PipelineError;
use crate::space::LabelVolume;

/// Labels from which on the question is asked. Images of 8 bits have up to 255, atlases of subcortical or thoracic organs
/// fewer than this; what has less is a label map of a few parts, be they ever so small.
const MANY: usize = 100;
/// Voxels of a label that can be no sheet: a cube of three. Where most labels have no more, nothing is there to measure.
const FEW_VOXELS: u64 = 27;
/// Voxels of a row that have the same label on end, in the mean. Noise leaves 1.0 to 1.2, a ribbon of cortex two voxels
/// thick makes 2.
const SHORT_RUN: f64 = 1.5;

/// Refuses an image of intensities.
///
/// # Errors
/// [`Refusal::IntensityImage`] when it is one; when it is cancelled.
pub(super) fn check_is_label_map(volume: &LabelVolume, cancel: &dyn Cancel) -> Result<(), PipelineError> {
    let labels = volume.labels().len();
    if labels < MANY {
        return Ok(());
    }
    let run_voxels = mean_run(volume, cancel)?;
    let small_labels = (1..=u16::MAX).take(labels).filter(|index| volume.voxels_of(*index) <= FEW_VOXELS).count();
    if run_voxels < SHORT_RUN || 2 * small_labels > labels {
        return Err(Refusal::IntensityImage { labels, small_labels, run_voxels }.into());
    }
    Ok(())
}

/// Voxels of a row that have the same label on end, in the mean; the background is left out.
fn mean_run(volume: &LabelVolume, cancel: &dyn Cancel) -> Result<f64, Cancelled> {
    let (mut voxels, mut runs) = (0_u64, 0_u64);
    let layers = volume.layers().map(|layer| layer.as_slice().chunks_exact(volume.dims()[0]));
    for row in layers.flatten() {
        cancel.check()?;
        let mut last = 0;
        for index in row {
            voxels += u64::from(*index != 0);
            runs += u64::from(*index != 0 && *index != last);
            last = *index;
        }
    }
    Ok(voxels as f64 / runs.max(1) as f64)
}
