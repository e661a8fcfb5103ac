//! From work space to the world: what the stages found, as the plain data of the model.

use nalgebra::{Point2, Point3};

use super::division::{Group, Joint};
use super::draft::Draft;
use super::medial::MedialSurface;
use super::plane::Flat;
use super::quality::Measured;
use super::quality::measures::FlatQuads;
use super::sheets::Sheets;
use super::sides::SheetSides;
use super::solid::Solid;
use super::stages::{Figures, Worked};
use super::tubes::{Fork, TubeDraft};
use crate::model::{Figure, FigureQuality, Flanks, FlatPoints, Junction, PerSurface, Sheet, Structure, Tube};
use crate::space::ParamPoint;

/// Writes the figures of a structure, part by part, their junctions and qualities into it.
pub(super) fn hand_out(parts: Vec<Worked>, measured: Measured, structure: &mut Structure) {
    let (mut of_figures, mut of_parts) = (measured.figures.into_iter(), measured.parts.into_iter());
    structure.quality = measured.structure;
    for worked in parts {
        let before = structure.figures.len();
        for group in &worked.division.groups {
            hand_out_group(&worked, group, &mut of_figures, structure);
        }
        for Joint { figures, places } in &worked.division.joints {
            let figures = figures.iter().map(|figure| figure + before).collect();
            structure.junctions.push(Junction { figures, points: worked.solid.in_world(places) });
        }
        let part = &mut structure.parts[worked.part];
        part.figures = (before..structure.figures.len()).collect();
        (part.kept_share, part.coverage) = of_parts.next().unwrap_or_default();
    }
}

/// The figures of a solid or of a portion of it, and their junctions.
fn hand_out_group(
    worked: &Worked,
    group: &Group,
    qualities: &mut impl Iterator<Item = FigureQuality>,
    structure: &mut Structure,
) {
    let before = structure.figures.len();
    match &group.figures {
        Figures::Sheets { sides, drafts, .. } => {
            for (sheet, draft) in sides.iter().zip(drafts) {
                let Some(draft) = draft else { continue };
                let quality = qualities.next().unwrap_or_default();
                let sheet = Sheet { part: worked.part, ..sheet_figure(&worked.solid, sheet, draft, quality) };
                structure.figures.push(Figure::Sheet(sheet));
            }
        }
        Figures::Tubes(tubes) => {
            for draft in &tubes.drafts {
                let quality = qualities.next().unwrap_or_default();
                let parent = draft.parent.map(|parent| parent + before);
                let tube = Tube { part: worked.part, parent, ..tube_figure(&worked.solid, draft, quality) };
                structure.figures.push(Figure::Tube(tube));
            }
        }
    }
    for Junction { figures, points } in junctions(&worked.solid, group) {
        let figures = figures.into_iter().map(|figure| figure + before).collect();
        structure.junctions.push(Junction { figures, points });
    }
    structure.pruning.pruned += group.figures.pruned();
}

fn in_mm(points: &[Point2<f64>], voxel_mm: f64) -> Vec<ParamPoint> {
    points.iter().map(|p| ParamPoint::from(p.coords * voxel_mm)).collect()
}

/// A finished tube in the world.
fn tube_figure(solid: &Solid, draft: &TubeDraft, quality: FigureQuality) -> Tube {
    let (nodes, mm) = (&draft.nodes, solid.unit_mm);
    Tube {
        grid: nodes.size,
        centreline: solid.in_world(&nodes.centres),
        wall: solid.in_world(&nodes.wall),
        tips: nodes.tips.map(|tip| solid.world_from_work.point(tip)),
        caps: nodes.caps,
        repaired: draft.repaired.clone(),
        medial_radius_mm: draft.radii.iter().map(|r| r * mm).collect(),
        intrinsic: in_mm(&draft.intrinsic, mm),
        quality,
        frame: draft.frame.clone(),
        automatic: draft.choices.clone(),
        uncertainty: None,
        part: 0,
        parent: None,
    }
}

/// A finished sheet in the world.
fn sheet_figure(solid: &Solid, sheet: &SheetSides, draft: &Draft, quality: FigureQuality) -> Sheet {
    let Draft { nodes, flat, frame, choices, .. } = draft;
    let mm = solid.unit_mm;
    Sheet {
        grid: nodes.size,
        medial: solid.in_world(&nodes.medial),
        upper: solid.in_world(&nodes.upper),
        lower: solid.in_world(&nodes.lower),
        crest: solid.in_world(&nodes.crest),
        flanks: flanks_in_world(solid, &nodes.flanks),
        valid: nodes.valid.clone(),
        repaired: nodes.repaired.clone(),
        medial_radius_mm: nodes.radii.iter().map(|r| r * mm).collect(),
        area_distortion: FlatQuads::from(nodes).log_ratio_per_node(),
        intrinsic: nodes.intrinsic.map(|points| in_mm(points, mm)),
        neighbors: flat.map(|flat| flat.embedded.map(|embedded| embedded.neighbors)),
        landmarks: flat.map(|flat| flat.embedded.map_or(0, |embedded| embedded.landmarks)),
        points: PerSurface {
            medial: flat_points(solid, &sheet.medial.positions, &flat.medial),
            upper: flat_points(solid, &sheet.upper.surface.positions, &flat.upper),
            lower: flat_points(solid, &sheet.lower.surface.positions, &flat.lower),
        },
        quality,
        frame: frame.clone(),
        automatic: choices.clone(),
        uncertainty: None,
        part: 0,
    }
}

fn flanks_in_world(solid: &Solid, flanks: &[Flanks]) -> Vec<Flanks> {
    let mut all = Vec::with_capacity(flanks.len());
    for flanks in flanks {
        all.push(flanks.map(|flank| flank.map(|point| solid.world_from_work.point(point))));
    }
    all
}

/// The points of a surface and where they were laid.
fn flat_points(solid: &Solid, positions: &[Point3<f64>], flat: &Flat) -> FlatPoints {
    FlatPoints { positions: solid.in_world(positions), flat: in_mm(&flat.points, solid.unit_mm) }
}

/// Where the figures that were kept meet.
fn junctions(solid: &Solid, group: &Group) -> Vec<Junction> {
    match &group.figures {
        Figures::Sheets { sheets, drafts, .. } => {
            let mut all = hinges((solid, &group.surface), sheets, drafts);
            all.extend(banks(solid, drafts));
            all
        }
        Figures::Tubes(tubes) => forks(solid, &tubes.forks),
    }
}

/// Where rings meet themselves.
fn banks(solid: &Solid, drafts: &[Option<Draft>]) -> Vec<Junction> {
    let mut all = Vec::new();
    for (number, Draft { nodes, .. }) in drafts.iter().flatten().enumerate() {
        if nodes.links().is_ring {
            let bank: Vec<Point3<f64>> = nodes.medial.iter().step_by(nodes.size.cols).copied().collect();
            all.push(Junction { figures: vec![number; 2], points: solid.in_world(&bank) });
        }
    }
    all
}

/// Where tubes meet.
fn forks(solid: &Solid, forks: &[Fork]) -> Vec<Junction> {
    let junction = |fork: &Fork| Junction { figures: fork.tubes.clone(), points: solid.in_world(&fork.places) };
    forks.iter().map(junction).collect()
}

/// Hinges between the sheets that were kept.
fn hinges((solid, surface): (&Solid, &MedialSurface), sheets: &Sheets, drafts: &[Option<Draft>]) -> Vec<Junction> {
    let mut number = Vec::new();
    for draft in drafts {
        number.push(draft.is_some().then(|| number.iter().flatten().count()));
    }
    let mut all = Vec::new();
    for hinge in &sheets.hinges {
        let figures: Vec<usize> = hinge.sheets.iter().filter_map(|&s| number[s as usize]).collect();
        if figures.len() > 1 {
            let points = hinge.points.iter().map(|&p| surface.points[p as usize].position).collect::<Vec<_>>();
            all.push(Junction { figures, points: solid.in_world(&points) });
        }
    }
    all
}
