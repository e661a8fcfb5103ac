//! Solids that stand in for those of the paper's figures, which are not ours to give. They have the size and the bends of
//! what they are called, and a medial sheet that is known; none is an organ.

use std::f64::consts::PI;

use medialrep::samples::{Patch, Sample, Solid, by_name};
use nalgebra::{Point3, Vector3};

/// From `[0, 1]` to `[-1, 1]`.
fn centred(share: f64) -> f64 {
    2.0 * share - 1.0
}

fn one(name: &'static str, about: &'static str, patches: Vec<Patch>) -> Sample {
    Sample::new(name, about, vec![Solid::new(1, patches)])
}

/// An egg that is flatter than it is wide: narrow in front, broad behind, bent over its length.
pub fn thalamus() -> Sample {
    let plate = Patch::new(
        |s, t| {
            let (along, across) = (centred(s), centred(t));
            let half_width = (6.2 - 1.6 * along) * (1.0 - 0.8 * along * along).sqrt();
            let height = -1.8 * along * along - 0.8 * across * across;
            let middle = Point3::new(-12.0 - 2.0 * along, -18.0 + 11.0 * along, 8.0 + height);
            middle + Vector3::new(0.94, 0.17, 0.3) * (half_width * across)
        },
        |s, t| 5.2 - 1.3 * centred(s).powi(2) - 0.3 * centred(s) - 1.1 * centred(t).powi(2),
    );
    one("thalamus", "like a thalamus", vec![plate])
}

/// The sample `leaf`: a thick head, a thin tail, bent and twisted.
pub fn caudate() -> Sample {
    by_name("leaf").expect("a sample of that name")
}

/// A fan that runs out of a tendon into a broad belly, hollow below.
pub fn supraspinatus() -> Sample {
    let fan = Patch::new(
        |s, t| {
            let (spread, reach) = (centred(t) * 0.42, 24.0 + 74.0 * s);
            let sag = 0.0016 * reach * reach - 5.0 * centred(t).powi(2) * s;
            Point3::new(60.0 - reach * spread.cos(), reach * spread.sin() - 20.0, 30.0 + sag)
        },
        |s, t| (4.2 + 6.0 * (PI * (0.06 + 0.86 * s)).sin()) * (1.0 - 0.3 * centred(t).powi(2)),
    );
    one("supraspinatus", "like a supraspinatus muscle", vec![fan])
}

/// A bent plate with a fin above and another below: five sheets that meet in two hinges.
pub fn finned_plate() -> Sample {
    let height = |x: f64| -0.006 * x * x;
    let plate = |from: f64, to: f64| {
        Patch::new(
            move |s, t| {
                let x = from + (to - from) * s;
                Point3::new(x, centred(t) * 20.0, height(x))
            },
            |_, _| 3.4,
        )
    };
    let fin = |x: f64, lean: f64, rise: f64| {
        Patch::new(
            move |s, t| Point3::new(x + lean * s, centred(t) * (20.0 - 4.0 * s), height(x) + rise * s),
            |_, _| 3.0,
        )
    };
    let sheets =
        vec![plate(-36.0, -10.0), plate(-10.0, 14.0), plate(14.0, 40.0), fin(-10.0, -4.0, 24.0), fin(14.0, 3.0, -22.0)];
    one("finned_plate", "a plate with two fins", sheets)
}
