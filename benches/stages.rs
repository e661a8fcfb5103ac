//! What each stage costs on one shape at three sizes, and the whole from file to files.
//!
//! `cargo bench` (or `make bench`) prints times on one thread; `cargo bench -- skeleton` takes one
//! stage. Sizes are names of groups: voxels of the shape's box.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use medialrep::formats::nifti_write;
use medialrep::formats::{InputLimits, read};
use medialrep::jobs::process::process;
use medialrep::model::LatticeSize;
use medialrep::model::{FigureQuality, Repair};
use medialrep::params::{Landmarks, LatticeKind, Neighbors, Params, Prune};
use medialrep::pipeline::lattice::lattice;
use medialrep::pipeline::lattice::outline::Region;
use medialrep::pipeline::lattice::rim::{WholeSheet, to_rim};
use medialrep::pipeline::medial::{MedialSurface, medial_surface};
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::plane::frame::{Senses, framed};
use medialrep::pipeline::plane::isomap::{Flat, flatten};
use medialrep::pipeline::plane::strip::{unfolded, widened};
use medialrep::pipeline::quality::structure_quality;
use medialrep::pipeline::sheets::sides::{SheetSides, sides};
use medialrep::pipeline::sheets::{Sheets, sheets};
use medialrep::pipeline::solid::depth::{Depth, depth, skin};
use medialrep::pipeline::solid::{LabelBox, Solid, label_boxes, solid};
use medialrep::pipeline::vectors::Nodes;
use medialrep::pipeline::vectors::anchored::anchored;
use medialrep::samples::by_name;
use medialrep::space::LabelVolume;
use nalgebra::Rotation3;

const SIZE: LatticeSize = LatticeSize { rows: 6, cols: 8 };
/// Voxel edges, mm: each halving is eight times the voxels.
const SPACINGS_MM: [f64; 3] = [2.0, 1.0, 0.5];

/// What every stage of one shape starts from.
struct Stages {
    volume: LabelVolume,
    bounds: LabelBox,
    solid: Solid,
    depth: Depth,
    surface: MedialSurface,
    sheets: Sheets,
    sides: Vec<SheetSides>,
    flat: Flat,
    whole: WholeSheet,
    nodes: Nodes,
    repair: Repair,
}

impl Stages {
    fn of(spacing_mm: f64) -> Self {
        let sample = by_name("bent_even").expect("a sample of that name");
        let volume = sample.voxelise([spacing_mm; 3], Rotation3::identity()).expect("fits in memory");
        let bounds = label_boxes(&volume, &Silent).expect("not cancelled")[1].expect("label 1 is there");
        let solid = solid(&volume, 1, bounds, None, &mut Vec::new(), &Silent).expect("a solid");
        let depth = depths(&solid);
        let surface = medial_surface(&solid, &depth, &Silent).expect("not cancelled");
        let sheets = sheets(&surface, &depth, Prune::Auto, None, &Silent).expect("not cancelled");
        let senses = senses(&solid);
        let sides = sides(&depth, &solid.world_from_work, &surface, &sheets, &senses, &Silent).expect("orientable");
        let flat = laid_flat(&sides[0], solid.voxel_mm);
        let whole = whole_sheet(&sides[0], &flat, &solid, &depth, &senses);
        let (nodes, repair) = spokes(&solid, &depth, &sides[0], &whole);
        Self { volume, bounds, solid, depth, surface, sheets, sides, flat, whole, nodes, repair }
    }

    fn box_voxels(&self) -> u64 {
        self.bounds.voxels()
    }
}

fn depths(solid: &Solid) -> Depth {
    depth(solid, skin(solid, &Silent).expect("not cancelled"), &Silent).expect("not cancelled")
}

fn senses(solid: &Solid) -> Senses {
    Senses::of(&solid.inside, &solid.world_from_work, &Silent).expect("not cancelled")
}

fn laid_flat(sheet: &SheetSides, voxel_mm: f64) -> Flat {
    flatten(&sheet.medial, Neighbors::Auto, Landmarks::Auto, voxel_mm, &Silent).expect("a plane")
}

fn whole_sheet(sheet: &SheetSides, flat: &Flat, solid: &Solid, depth: &Depth, senses: &Senses) -> WholeSheet {
    let (points, _) = framed(&flat.points, sheet, solid, senses, &Silent).expect("not cancelled");
    let points = unfolded(sheet, &points, &Silent).expect("not cancelled");
    let points = widened(sheet, &points, depth, &Silent).expect("not cancelled");
    let region = Region::of(&points.flat, &Silent).expect("not cancelled");
    to_rim(&points, &region, &sheet.hinge, solid, depth, &Silent).expect("not cancelled")
}

fn spokes(solid: &Solid, depth: &Depth, sheet: &SheetSides, whole: &WholeSheet) -> (Nodes, Repair) {
    let lattice = lattice(&whole.region, LatticeKind::Fitted, SIZE, 0.05, 0.0, &Silent).expect("not cancelled");
    anchored(solid, depth, sheet, whole, lattice.expect("a lattice"), &Silent).expect("not cancelled")
}

fn stages(criterion: &mut Criterion) {
    for spacing_mm in SPACINGS_MM {
        let s = Stages::of(spacing_mm);
        let senses = senses(&s.solid);
        let mut stage = |name: &str, work: &mut dyn FnMut()| {
            criterion.bench_function(&format!("{name}/{}", s.box_voxels()), |bencher| bencher.iter(&mut *work));
        };
        stage("mask", &mut || {
            black_box(solid(&s.volume, 1, s.bounds, None, &mut Vec::new(), &Silent)).ok();
        });
        stage("distance", &mut || {
            black_box(depths(&s.solid));
        });
        stage("skeleton", &mut || {
            black_box(medial_surface(&s.solid, &s.depth, &Silent)).ok();
        });
        stage("sheets", &mut || {
            black_box(sheets(&s.surface, &s.depth, Prune::Auto, None, &Silent)).ok();
        });
        stage("sides", &mut || {
            black_box(sides(&s.depth, &s.solid.world_from_work, &s.surface, &s.sheets, &senses, &Silent)).ok();
        });
        stage("isomap", &mut || {
            black_box(laid_flat(&s.sides[0], s.solid.voxel_mm));
        });
        stage("lattice", &mut || {
            black_box(whole_sheet(&s.sides[0], &s.flat, &s.solid, &s.depth, &senses));
        });
        stage("spokes", &mut || {
            black_box(spokes(&s.solid, &s.depth, &s.sides[0], &s.whole));
        });
        stage("quality", &mut || {
            let mut qualities = [FigureQuality { repair: s.repair, ..FigureQuality::default() }];
            let nodes = std::slice::from_ref(&s.nodes);
            black_box(structure_quality(&s.solid, &s.depth, nodes, &mut qualities, &Silent)).ok();
        });
    }
}

fn whole(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let params = Params::default().check().expect("the defaults are in range");
    for spacing_mm in SPACINGS_MM {
        let sample = by_name("bent_even").expect("a sample of that name");
        let volume = sample.voxelise([spacing_mm; 3], Rotation3::identity()).expect("fits in memory");
        let voxels = label_boxes(&volume, &Silent).expect("not cancelled")[1].expect("label 1 is there").voxels();
        let file = folder.path().join("mask.nii.gz");
        nifti_write::write(&volume, std::fs::File::create(&file).expect("a file")).expect("written");
        criterion.bench_function(&format!("read/{voxels}"), |bencher| {
            bencher
                .iter(|| read(std::fs::File::open(&file).expect("the file"), InputLimits::default()).expect("a mask"));
        });
        criterion.bench_function(&format!("whole/{voxels}"), |bencher| {
            bencher.iter(|| process(&file, &params, InputLimits::default(), folder.path(), &Silent).expect("a result"));
        });
    }
}

/// A few long samples, all on one thread.
fn configured() -> Criterion {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the first pool");
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! { name = benches; config = configured(); targets = stages, whole }
criterion_main!(benches);
