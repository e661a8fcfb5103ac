//! The embeddings on sheets of analytic shapes.

use medialrep::pipeline::depth::{depth, skin};
use medialrep::pipeline::embedding::{Embedding, MAX_TURNED_OVER, laid};
use medialrep::pipeline::mask::{label_boxes, solid};
use medialrep::pipeline::medial::medial_surface;
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::params::{Landmarks, Neighbors, Prune};
use medialrep::pipeline::sheets::sheets;
use medialrep::pipeline::surface::Surface;

use crate::phantoms::volume;

/// The sheets of a sample at 1 mm.
fn sheets_of(name: &str) -> Vec<Surface> {
    let volume = volume(name);
    let bounds = label_boxes(&volume, &Silent).unwrap()[1].expect("label 1 is there");
    let solid = solid(&volume, 1, bounds, None, &mut Vec::new(), &Silent).expect("a solid");
    let depth = depth(&solid, skin(&solid, &Silent).unwrap(), &Silent).unwrap();
    let surface = medial_surface(&solid, &depth, &Silent).expect("not cancelled");
    let found = sheets(&surface, &depth, Prune::Auto, None, &Silent).expect("not cancelled");
    found.members.iter().map(|members| surface.part(members, &Silent).expect("not cancelled")).collect()
}

/// Every embedding of every sheet of a shape: LLE keeps angles better than ISOMAP does, and nothing is turned
/// over by any of the three.
fn check_embeddings(name: &str) {
    for (number, sheet) in sheets_of(name).into_iter().enumerate() {
        let kept = sheet.part(&sheet.largest_piece(&Silent).unwrap(), &Silent).unwrap();
        let angle_error = |embedding: Embedding| {
            let plane = laid(&kept, embedding, Neighbors::Auto, Landmarks::Auto, 1.0, &Silent).expect("a plane");
            let distortion = plane.distortion.expect("judged");
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
