//! The embeddings on sheets of analytic shapes.

use medialrep::cancel::Never;
use medialrep::model::Verdict;
use medialrep::params::{Correspondence, Embedding, Landmarks, Neighbors, Params};
use medialrep::pipeline::PipelineError;
use medialrep::pipeline::medial::medial_surface;
use medialrep::pipeline::plane::embedding::{MAX_TURNED_OVER, Method, flatten};
use medialrep::pipeline::sheets::{Joining, sheets};
use medialrep::pipeline::surface::Surface;

use crate::help::phantoms::{check_invariants, context, deepened, defaults, model_of, params, run_of, volume};

/// The largest piece of each sheet of a sample at 1 mm.
fn sheets_of(name: &str) -> Vec<Surface> {
    let (solid, depth) = deepened(&volume(name));
    let params = defaults();
    let context = context(&params);
    let surface = medial_surface(&solid, &depth, &context).expect("not cancelled");
    let found = sheets(&surface, &solid, &depth, Joining::Alone, &context).expect("not cancelled");
    let mut all = Vec::new();
    for members in &found.members {
        let sheet = surface.part(members, &Never).expect("not cancelled");
        all.push(sheet.part(&sheet.largest_piece(&Never).unwrap(), &Never).unwrap());
    }
    all
}

/// Every embedding of every sheet of a shape: LLE keeps angles better than ISOMAP does, and nothing is turned
/// over by any of the three.
#[track_caller]
fn check_embeddings(name: &str) {
    for (number, sheet) in sheets_of(name).iter().enumerate() {
        let angle_error = |embedding: Embedding| {
            let method = Method { embedding, neighbors: Neighbors::Auto, landmarks: Landmarks::Auto };
            let flat = flatten(sheet, method, 1.0, u64::MAX, &Never).expect("a plane");
            let distortion = flat.distortion(sheet, &Never).expect("not cancelled").expect("judged");
            assert!(distortion.turned_over < MAX_TURNED_OVER / 4.0, "{name} {number} {embedding:?}: {distortion:?}");
            distortion.angle_error_deg
        };
        let [isomap, lle] = [Embedding::Isomap, Embedding::Lle].map(angle_error);
        assert!(lle <= isomap && isomap < 1.5, "{name} {number}: LLE {lle:.2}°, ISOMAP {isomap:.2}°");
        // It crowds the points of the rim.
        let laplacian = angle_error(Embedding::Laplacian);
        assert!(laplacian < 35.0, "{name} {number}: {laplacian:.1}°");
    }
}

#[test]
fn lle_keeps_the_angles_of_flat_and_bent_sheets_better_than_isomap() {
    for name in ["ellipsoid", "bent_even", "bump", "thick_bend", "half_bent", "twisted"] {
        check_embeddings(name);
    }
}

#[test]
fn lle_keeps_the_angles_of_sheets_at_junctions_better_than_isomap() {
    for name in ["tee", "wye", "cross"] {
        check_embeddings(name);
    }
}

/// The verdict of a sample with its sides laid flat on their own, by an embedding.
fn paper_verdict(name: &str, embedding: Embedding) -> Verdict {
    let model = model_of(&volume(name), Params { embedding, correspondence: Correspondence::Paper, ..params() });
    check_invariants(&model);
    let figure = model.structures[0].sheets().next().expect("a sheet");
    for (surface, plane) in figure.quality.embedding.named() {
        let plane = plane.as_ref().expect("each surface is laid flat on its own");
        assert!(plane.turned_over.is_some() && plane.angle_error_deg.is_some(), "{surface}: {plane:?}");
    }
    model.structures[0].quality.verdict
}

#[test]
fn the_sides_are_laid_flat_by_the_same_embedding() {
    for embedding in Embedding::ALL {
        assert_ne!(paper_verdict("ellipsoid", embedding), Verdict::Fail, "{embedding:?}");
    }
}

#[test]
fn every_embedding_ends_in_a_result_or_a_typed_refusal_on_every_sample() {
    for (name, _) in medialrep::samples::list() {
        let volume = volume(name);
        for embedding in [Embedding::Lle, Embedding::Laplacian] {
            match run_of(&volume, Params { embedding, ..params() }) {
                Ok(model) => check_invariants(&model),
                Err(PipelineError::Refused(_)) => {}
                Err(PipelineError::Cancelled(_)) => panic!("nobody cancels"),
            }
        }
    }
}
