//! Models made by hand, for the writers.

use medialrep::model::Automatic;
use medialrep::model::FrameFacts;
use medialrep::model::LatticeSize;
use medialrep::model::Refusal;
use medialrep::model::{
    Coverage, Figure, FigureQuality, Flanks, FlatPoints, Junction, LabelPart, LatticePlace, Model, PerSurface, Pruning,
    Reason, Repair, Sheet, Side, StageTimings, Structure, StructureQuality, TriangleMesh, Verdict, ring,
    straight_flanks,
};
use medialrep::model::{Stage, Warning};
use medialrep::params::Params;
use medialrep::pipeline::draft::Draft;
use medialrep::pipeline::vectors::Nodes;
use medialrep::space::{ParamPoint, WorldFromVoxel, WorldPoint, WorldVector};
use nalgebra::{Point3, Vector3};

/// A slab bent over a cylinder of 40 mm, nodes 5 mm apart along the bend and along its axis; 3
/// to 4 mm thick above, 2 mm below.
pub fn bent_slab(grid: LatticeSize) -> Sheet {
    let flat: Vec<ParamPoint> = (0..grid.rows * grid.cols)
        .map(|n| ParamPoint::new(5.0 * (n % grid.cols) as f64, 5.0 * (n / grid.cols) as f64))
        .collect();
    let at = |uv: &ParamPoint, height: f64| {
        let (sin, cos) = (uv.x / 40.0).sin_cos();
        WorldPoint::new((40.0 + height) * sin, uv.y, (40.0 + height) * cos)
    };
    let medial: Vec<WorldPoint> = flat.iter().map(|uv| at(uv, 0.0)).collect();
    let upper: Vec<WorldPoint> = flat.iter().map(|uv| at(uv, 3.0 + uv.y / 40.0)).collect();
    let lower: Vec<WorldPoint> = flat.iter().map(|uv| at(uv, -2.0)).collect();
    let center = WorldPoint::from(medial.iter().map(|p| p.coords).sum::<WorldVector>() / medial.len() as f64);
    let crest: Vec<WorldPoint> =
        ring(grid).iter().map(|n| medial[*n] + (medial[*n] - center).normalize() * 2.5).collect();
    let flanks = flanks_of(grid, &upper, &crest, &lower);
    let points = |positions: &Vec<WorldPoint>| FlatPoints { positions: positions.clone(), flat: flat.clone() };
    Sheet {
        grid,
        crest,
        flanks,
        valid: vec![true; flat.len()],
        repaired: vec![None; flat.len()],
        medial_radius_mm: vec![2.0; flat.len()],
        area_distortion: vec![Some(0.25); flat.len()],
        intrinsic: PerSurface { medial: flat.clone(), upper: flat.clone(), lower: flat.clone() },
        neighbors: PerSurface { medial: Some(30.5), upper: Some(28.0), lower: Some(28.0) },
        landmarks: PerSurface { medial: 60, upper: 60, lower: 60 },
        points: PerSurface { medial: points(&medial), upper: points(&upper), lower: points(&lower) },
        quality: FigureQuality {
            folded_cells: vec![LatticePlace { side: Side::Upper, i: 1, j: 2 }],
            folds: 1,
            valid_share: 1.0,
            ..FigureQuality::default()
        },
        frame: FrameFacts {
            aspect: 1.25,
            ambiguities: vec!["the sheet is nearly square".to_owned()],
            ..FrameFacts::default()
        },
        automatic: Automatic { length_mm: 35.0, width_mm: 25.0, ..Automatic::default() },
        uncertainty: None,
        part: 0,
        medial,
        upper,
        lower,
    }
}

/// Nodes of a flat slab: rows 2 apart along x, columns 3 apart along y, 1.5 thick on each side;
/// the crest is 1 further out, diagonally at the corners.
pub fn flat_slab(size: LatticeSize) -> Nodes {
    let plane: Vec<ParamPoint> = (0..size.rows * size.cols)
        .map(|n| ParamPoint::new(3.0 * (n % size.cols) as f64, 2.0 * (n / size.cols) as f64))
        .collect();
    let at = |z: f64| plane.iter().map(|p| Point3::new(p.y, p.x, z)).collect::<Vec<_>>();
    let medial = at(0.0);
    let crest: Vec<_> = ring(size).iter().map(|&n| medial[n] + outward(size, n)).collect();
    Nodes {
        size,
        radii: vec![1.5; medial.len()],
        flanks: flanks_of(size, &at(1.5), &crest, &at(-1.5)),
        upper: at(1.5),
        lower: at(-1.5),
        crest,
        valid: vec![true; medial.len()],
        repaired: vec![None; medial.len()],
        intrinsic: PerSurface { medial: plane.clone(), upper: plane.clone(), lower: plane },
        medial,
    }
}

/// Straight arcs over the crest.
fn flanks_of(size: LatticeSize, upper: &[WorldPoint], crest: &[WorldPoint], lower: &[WorldPoint]) -> Vec<Flanks> {
    ring(size).iter().zip(crest).map(|(&n, &crest)| straight_flanks(upper[n], crest, lower[n])).collect()
}

/// The same nodes with straight arcs over their crest.
pub fn with_straight_arcs(nodes: &Nodes) -> Nodes {
    let mut nodes = nodes.clone();
    nodes.straighten_arcs();
    nodes
}

/// Away from the lattice at an edge node of [`flat_slab`].
pub fn outward(size: LatticeSize, node: usize) -> Vector3<f64> {
    let (i, j) = (node / size.cols, node % size.cols);
    let along = |at: usize, count: usize| f64::from(u8::from(at + 1 == count)) - f64::from(u8::from(at == 0));
    Vector3::new(along(i, size.rows), along(j, size.cols), 0.0)
}

/// A structure of that figure with a tetrahedron as its object.
pub fn structure(label: i64, sheets: Vec<Sheet>) -> Structure {
    let reason = Reason {
        code: "few_nodes".into(),
        message: "few nodes".to_owned(),
        value: 0.1 + 0.2,
        threshold: f64::NAN,
        place: None,
    };
    Structure {
        label,
        name: None,
        color: None,
        code: None,
        voxels: 3600,
        volume_mm3: 3600.0,
        working_voxel_mm: 1.0,
        grain_mm: [1.0; 3],
        parts: vec![LabelPart { voxels: 3600, figures: (0..sheets.len()).collect(), ..LabelPart::default() }],
        figures: sheets.into_iter().map(Figure::Sheet).collect(),
        junctions: vec![Junction { figures: vec![0], points: vec![WorldPoint::new(1.0, 2.0, 3.0)] }],
        pruning: Pruning { strength: 0.5, loss_needed: 0.03, pruned: 0 },
        quality: StructureQuality {
            verdict: Verdict::Warn,
            reasons: vec![reason],
            coverage: Coverage { dice: 0.96, ..Coverage::default() },
            ..StructureQuality::default()
        },
        warnings: vec![Warning { code: "a_warning".into(), message: "a \"quoted\" warning".to_owned() }],
        refusal: None,
        object: TriangleMesh {
            positions: [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]]
                .map(WorldPoint::from)
                .to_vec(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        },
        timings: StageTimings([1.5; Stage::ALL.len()]),
    }
}

/// One structure with a full figure and one with a hole in it, and one that was refused.
pub fn model() -> Model {
    let mut holed = bent_slab(LatticeSize { rows: 5, cols: 6 });
    holed.valid[0] = false;
    holed.area_distortion[0] = None;
    holed.medial[0] = WorldPoint::new(f64::NAN, 0.0, 0.0);
    let mut refused = structure(2101, Vec::new());
    refused.refusal = Some(Refusal::TooSmall { points: 3, needed: 9 });
    refused.object = TriangleMesh::default();
    Model {
        params: Params::default().check().unwrap(),
        world_from_voxel: WorldFromVoxel::axis_aligned([1.0, 1.0, 2.0], [-10.0, 0.0, 5.5]).unwrap(),
        dims: [90, 80, 70],
        structures: vec![structure(11, vec![bent_slab(LatticeSize { rows: 6, cols: 8 }), holed]), refused],
    }
}

/// A figure on its way, of these nodes and nothing else.
pub fn drafted(nodes: Nodes) -> Draft {
    Draft {
        nodes,
        flat: PerSurface::default(),
        distortion: PerSurface::default(),
        frame: FrameFacts::default(),
        choices: Automatic::default(),
        repair: Repair::default(),
        asked: None,
    }
}
