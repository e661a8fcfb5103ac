//! All stages for one label.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use nalgebra::{Point2, Point3};

use crate::numerics::surface_nets::zero_surface;
use crate::space::{LabelVolume, ParamPoint, WorldPoint};

use crate::model::Refusal;
use crate::model::{Automatic, FrameFacts};
use crate::model::{
    Figure, FlatPoints, Junction, PerSurface, Repair, StageTimings, Structure, StructureQuality, TriangleMesh, Verdict,
};
use crate::model::{Stage, Warning};
use crate::params::CheckedParams;
use crate::params::Correspondence;
use crate::pipeline::PipelineError;
use crate::pipeline::lattice::automatic::{automatic, respaced};
use crate::pipeline::lattice::lattice;
use crate::pipeline::lattice::outline::{HOLES_REFUSED, Region};
use crate::pipeline::lattice::rim::to_rim;
use crate::pipeline::medial::{MedialSurface, medial_surface};
use crate::pipeline::observer::{Cancelled, Observer};
use crate::pipeline::plane::cut::{Laid, cut};
use crate::pipeline::plane::frame::{Senses, framed};
use crate::pipeline::plane::isomap::{Flat, IsomapError, flatten};
use crate::pipeline::plane::strip::{SheetPoints, unfolded, widened};
use crate::pipeline::quality::measures::FlatQuads;
use crate::pipeline::quality::{figure_quality, structure_quality};
use crate::pipeline::repeats::{Muted, Repeat, add_uncertainty};
use crate::pipeline::sheets::sides::{SheetSides, Side, sides};
use crate::pipeline::sheets::{Sheets, sheets};
use crate::pipeline::solid::depth::{Depth, depth, skin};
use crate::pipeline::solid::perturb::perturbed;
use crate::pipeline::solid::{LabelBox, Solid, solid};
use crate::pipeline::vectors::anchored::anchored;
use crate::pipeline::vectors::{Nodes, align_sides, lattices, paper};

/// Medial points that the main sheet needs: fewer are less than a lattice of 3 × 3 nodes with
/// something to fit each to.
const MIN_SHEET_POINTS: usize = 40;
/// A sheet shorter than this many radii is that of a ball, one narrower than this many that of a
/// tube.
const BALL_LENGTH: f64 = 1.0;
/// See [`BALL_LENGTH`].
const TUBE_WIDTH: f64 = 0.8;

/// Share of a sheet's area that holes may take before it is said that they were filled: gaps of a
/// voxel or two in a skeleton are no holes of the organ.
const HOLES_SAID: f64 = 0.02;

/// One label and what is asked of it.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// The label map.
    pub volume: &'a LabelVolume,
    /// Index of the label in it.
    pub index: u16,
    /// Its box.
    pub bounds: LabelBox,
    /// What is asked for.
    pub params: &'a CheckedParams,
    /// Who listens.
    pub observer: &'a dyn Observer,
    /// Which structure this is.
    pub number: usize,
    /// Of how many.
    pub count: usize,
    /// Which repeat for the uncertainty; `None` for the result itself.
    pub repeat: Option<Repeat<'a>>,
}

/// What all stages after the first stand on.
struct Body {
    solid: Solid,
    depth: Depth,
    senses: Senses,
}

/// A figure on its way: its nodes and its flattened surfaces.
struct Draft {
    nodes: Nodes,
    flat: PerSurface<Flat>,
    frame: FrameFacts,
    automatic: Automatic,
    repair: Repair,
}

impl Work<'_> {
    /// Runs all stages. A shape without a medial representation is a structure with a refusal.
    ///
    /// # Errors
    /// When the observer asks to stop.
    pub fn run(&self) -> Result<Structure, Cancelled> {
        let mut structure = self.blank();
        if self.is_repeated() {
            self.observer.repeated(self.number, self.count, 0, self.params.uncertainty);
        }
        match self.stages(&mut structure) {
            Ok(()) => {
                self.add_uncertainty(&mut structure)?;
                Ok(structure)
            }
            Err(PipelineError::Cancelled(stop)) => Err(stop),
            Err(PipelineError::Refused(refusal)) => {
                structure.quality.verdict = Verdict::Fail;
                structure.refusal = Some(refusal);
                Ok(structure)
            }
        }
    }

    fn is_repeated(&self) -> bool {
        self.params.uncertainty > 0 && self.repeat.is_none()
    }

    /// Computes the structure again with moved boundaries, as often as was asked for.
    fn add_uncertainty(&self, structure: &mut Structure) -> Result<(), Cancelled> {
        let repeats = self.params.uncertainty;
        if !self.is_repeated() {
            return Ok(());
        }
        let (muted, done) = (Muted(self.observer), AtomicUsize::new(0));
        add_uncertainty(&mut structure.figures, repeats, structure.working_voxel_mm, |repeat| {
            let figures = Work { observer: &muted, repeat: Some(repeat), ..*self }.run()?.figures;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            self.observer.repeated(self.number, self.count, done, repeats);
            Ok(figures)
        })?;
        for (number, figure) in structure.figures.iter().enumerate() {
            let matched = figure.uncertainty.as_ref().map_or(0, |found| found.matched);
            if 2 * matched < repeats {
                let message = format!("figure {number} was found again in {matched} of {repeats} repeats only");
                structure.warnings.push(Warning { code: "uncertainty_unmatched", message });
            }
        }
        Ok(())
    }

    fn blank(&self) -> Structure {
        let voxels = self.volume.label_voxels[usize::from(self.index)];
        Structure {
            label: self.volume.label_values[usize::from(self.index)],
            voxels,
            volume_mm3: voxels as f64 * self.volume.world_from_voxel.voxel_volume_mm3(),
            working_voxel_mm: 0.0,
            figures: Vec::new(),
            junctions: Vec::new(),
            pruned: 0,
            quality: StructureQuality::default(),
            warnings: Vec::new(),
            refusal: None,
            object: TriangleMesh::default(),
            timings: StageTimings::default(),
        }
    }

    /// Runs `work` as a stage: looks at the observer, reports, and takes the time. Of one that is stopped
    /// or refused no end is reported.
    fn stage<T, E: From<Cancelled>>(
        &self,
        timings: &mut StageTimings,
        stage: Stage,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        self.observer.check()?;
        self.observer.progress(self.number, self.count, stage, 0.0);
        let start = Instant::now();
        let result = work()?;
        timings.0[stage as usize] += start.elapsed().as_secs_f64() * 1e3;
        self.observer.progress(self.number, self.count, stage, 1.0);
        Ok(result)
    }

    fn stages(&self, out: &mut Structure) -> Result<(), PipelineError> {
        let (params, observer) = (self.params, self.observer);
        let mut timings = StageTimings::default();
        let (solid, skin) = self.stage(&mut timings, Stage::Mask, || {
            let resolution_mm = params.resolution_mm;
            let solid = solid(self.volume, self.index, self.bounds, resolution_mm, &mut out.warnings, observer)?;
            let solid = match self.repeat {
                Some(repeat) => perturbed(solid, repeat.number, observer)?,
                None => {
                    out.object = object_mesh(&solid, observer)?;
                    solid
                }
            };
            let skin = skin(&solid, observer)?;
            Ok::<_, PipelineError>((solid, skin))
        })?;
        out.working_voxel_mm = solid.voxel_mm;
        let body = self.stage(&mut timings, Stage::Distance, || {
            let depth = depth(&solid, skin, observer)?;
            let senses = Senses::of(&solid.inside, &solid.world_from_work, observer)?;
            Ok::<_, Cancelled>(Body { solid, depth, senses })
        })?;
        let Body { solid, depth, senses } = &body;
        let surface = self.stage(&mut timings, Stage::Skeleton, || medial_surface(solid, depth, observer))?;
        let sheets = self.stage(&mut timings, Stage::Sheets, || {
            sheets(&surface, depth, params.prune, params.max_figures, observer)
        })?;
        out.timings = timings;
        check_sheet(&surface, &sheets, solid)?;
        let start = Instant::now();
        let Laid { sheets, flat } = cut(&surface, sheets, params, solid.voxel_mm, observer, &mut out.warnings)?;
        timings.0[Stage::Isomap as usize] += start.elapsed().as_secs_f64() * 1e3;
        let sheet_sides = self.stage(&mut timings, Stage::Sides, || {
            sides(depth, &solid.world_from_work, &surface, &sheets, senses, observer)
        })?;
        let drafts = self.drafts(&body, &sheet_sides, flat, &mut timings, &mut out.warnings)?;
        out.timings = timings;
        let figures: Vec<Nodes> = drafts.iter().flatten().map(|d| d.nodes.clone()).collect();
        self.stage(&mut timings, Stage::Quality, || {
            for (sheet, draft) in sheet_sides.iter().zip(&drafts) {
                out.figures.extend(draft.as_ref().map(|d| figure(solid, sheet, d, observer)).transpose()?);
            }
            if self.repeat.is_none() {
                let mut qualities: Vec<_> = out.figures.iter().map(|f| f.quality.clone()).collect();
                out.quality = structure_quality(solid, depth, &figures, &mut qualities, observer)?;
                out.figures.iter_mut().zip(qualities).for_each(|(figure, quality)| figure.quality = quality);
                out.quality.pruned_sheets = sheets.pruned;
            }
            Ok::<_, Cancelled>(())
        })?;
        out.junctions = junctions(solid, &surface, &sheets, &drafts);
        out.pruned = sheets.pruned;
        if sheets.pruned > 0 {
            let message = format!("{} small branches of the skeleton were pruned", sheets.pruned);
            out.warnings.push(Warning { code: "branches_pruned", message });
        }
        out.timings = timings;
        Ok(())
    }

    /// Flattens every sheet and lays its lattice. A secondary sheet that cannot be is left out
    /// with a warning; the main one is refused.
    fn drafts(
        &self,
        body: &Body,
        sheets: &[SheetSides],
        flat: Vec<Option<Flat>>,
        timings: &mut StageTimings,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<Option<Draft>>, PipelineError> {
        let mut drafts = Vec::new();
        for (number, (sheet, flat)) in sheets.iter().zip(flat).enumerate() {
            match self.draft(body, (sheet, flat), number, timings, warnings) {
                Ok(draft) => drafts.push(Some(draft)),
                Err(PipelineError::Refused(refusal)) if number > 0 => {
                    let message = format!("sheet {number} was left out: {refusal}");
                    warnings.push(Warning { code: "sheet_left_out", message });
                    drafts.push(None);
                }
                Err(stop) => return Err(stop),
            }
        }
        Ok(drafts)
    }

    fn draft(
        &self,
        body: &Body,
        (sheet, flat): (&SheetSides, Option<Flat>),
        number: usize,
        timings: &mut StageTimings,
        warnings: &mut Vec<Warning>,
    ) -> Result<Draft, PipelineError> {
        let Body { solid, depth, .. } = body;
        let (flat, frame) =
            self.stage(timings, Stage::Isomap, || self.flatten_all(body, sheet, flat, number, warnings))?;
        let own_region = Region::of(&flat.medial.points, self.observer)?;
        if number == 0 {
            check_extents(&own_region, sheet, solid)?;
        }
        let points = match self.params.correspondence {
            Correspondence::Anchored => widened(sheet, &flat.medial.points, depth, self.observer)?,
            Correspondence::Paper => SheetPoints::default(),
        };
        let is_widened = points.flat.len() > flat.medial.points.len();
        let region = if is_widened { Region::of(&points.flat, self.observer)? } else { own_region };
        let share = region.hole_share;
        if share > HOLES_REFUSED {
            return Err(Refusal::SheetHasHoles { share, allowed: HOLES_REFUSED }.into());
        }
        if share > HOLES_SAID {
            let message = format!("holes in sheet {number} were filled: {:.1} % of its area", 100.0 * share);
            warnings.push(Warning { code: "sheet_holes_filled", message });
        }
        if !frame.ambiguities.is_empty() {
            let message = format!("another frame of sheet {number} is as good: {}", frame.ambiguities.join("; "));
            warnings.push(Warning { code: "frame_ambiguous", message });
        }
        let sized = |region: &Region| {
            let (size, automatic) = automatic(self.params, &flat, region, solid.voxel_mm);
            (self.repeat.and_then(|repeat| repeat.sizes.get(number).copied()).unwrap_or(size), automatic)
        };
        let too_small = || Refusal::TooSmall { points: sheet.medial.positions.len(), needed: MIN_SHEET_POINTS };
        if self.params.correspondence == Correspondence::Paper {
            let (size, automatic) = sized(&region);
            let lattices = self.stage(timings, Stage::Lattice, || lattices(&flat, self.params, size, self.observer))?;
            let lattices = lattices.ok_or_else(too_small)?;
            let nodes = self.stage(timings, Stage::Spokes, || paper(solid, sheet, &flat, lattices, self.observer))?;
            return Ok(Draft { nodes, flat, frame, automatic, repair: Repair::default() });
        }
        let (whole, automatic, lattice) = self.stage(timings, Stage::Lattice, || {
            let whole = to_rim(&points, &region, &sheet.hinge, solid, depth, self.observer)?;
            let (size, automatic) = sized(&whole.region);
            let (kind, margin) = (self.params.lattice, self.params.margin);
            let lay = |size| lattice(&whole.region, kind, size, margin, 0.0, self.observer);
            let mut lattice = lay(size)?;
            if let (None, Some(spacing_mm), Some(first)) = (self.repeat, self.params.spacing_mm, &lattice) {
                let better = respaced(first, spacing_mm / solid.voxel_mm);
                if better != size {
                    lattice = lay(better)?;
                }
            }
            Ok::<_, Cancelled>((whole, automatic, lattice))
        })?;
        let lattice = lattice.ok_or_else(too_small)?;
        let anchored = || anchored(solid, depth, sheet, &whole, lattice, self.observer);
        let (nodes, repair) = self.stage(timings, Stage::Spokes, anchored)?;
        Ok(Draft { nodes, flat, frame, automatic, repair })
    }

    /// ISOMAP of the sheet, unless it was laid flat before, and its sides, turned into one frame.
    fn flatten_all(
        &self,
        body: &Body,
        sheet: &SheetSides,
        laid: Option<Flat>,
        number: usize,
        warnings: &mut Vec<Warning>,
    ) -> Result<(PerSurface<Flat>, FrameFacts), PipelineError> {
        let solid = &body.solid;
        let mut flat_of = |name: &str, surface, laid: Option<Flat>| {
            let params = self.params;
            let flatten = || flatten(surface, params.neighbors, params.landmarks, solid.voxel_mm, self.observer);
            let flat = laid.map_or_else(flatten, Ok).map_err(|error| refused(error, sheet, solid.voxel_mm))?;
            if flat.pieces > 1 {
                let message = format!(
                    "the neighbourhood graph of the {name} surface of sheet {number} fell into {} pieces, joined through touching voxels",
                    flat.pieces
                );
                warnings.push(Warning { code: "neighborhood_too_small", message });
            }
            Ok::<Flat, PipelineError>(flat)
        };
        let mut medial = flat_of("medial", &sheet.medial, laid)?;
        let (points, frame) = framed(&medial.points, sheet, solid, &body.senses, self.observer)?;
        medial.points = points;
        if self.params.correspondence == Correspondence::Anchored {
            medial.points = unfolded(sheet, &medial.points, self.observer)?;
            // The sides take their coordinates from the sheet; they have no graph of their own.
            let carried = |side: &Side| Flat {
                points: side.partners.iter().map(|&p| medial.points[p as usize]).collect(),
                residual_variance: f64::NAN,
                neighbors: f64::NAN,
                landmarks: 0,
                pieces: 0,
            };
            return Ok((PerSurface { upper: carried(&sheet.upper), lower: carried(&sheet.lower), medial }, frame));
        }
        let mut flat = PerSurface {
            medial,
            upper: flat_of("upper", &sheet.upper.surface, None)?,
            lower: flat_of("lower", &sheet.lower.surface, None)?,
        };
        align_sides(sheet, &mut flat);
        Ok((flat, frame))
    }
}

fn refused(error: IsomapError, sheet: &SheetSides, voxel_mm: f64) -> PipelineError {
    let refusal = match error {
        IsomapError::Cancelled(stop) => return stop.into(),
        IsomapError::TooFewPoints { points } => Refusal::TooSmall { points, needed: MIN_SHEET_POINTS },
        IsomapError::TooManyForExact { points, limit } => Refusal::TooManyPoints { points, limit },
        IsomapError::NoPlane => {
            let from = sheet.medial.positions[0];
            let length = sheet.medial.positions.iter().map(|p| (p - from).norm()).fold(0.0, f64::max);
            let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
            Refusal::Tube { length_mm: length * voxel_mm, radius_mm: radius * voxel_mm }
        }
    };
    refusal.into()
}

/// Refuses an object whose medial surface has too few points for a sheet.
fn check_sheet(surface: &MedialSurface, sheets: &Sheets, solid: &Solid) -> Result<(), Refusal> {
    let points = sheets.members.first().map_or(0, Vec::len);
    if points >= MIN_SHEET_POINTS {
        return Ok(());
    }
    let radius = surface.points.iter().map(|p| p.radius).fold(0.0, f64::max);
    let volume = solid.inside.as_slice().iter().filter(|m| **m).count() as f64;
    let ball = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    if radius < 2.0 {
        let thickness_mm = 2.0 * radius * solid.voxel_mm;
        let resolution_mm = solid.voxel_mm * radius / 3.0;
        return Err(Refusal::TooThin { thickness_mm, voxels: 2.0 * radius, voxel_mm: solid.voxel_mm, resolution_mm });
    }
    if volume < 2.5 * ball {
        let radius_mm = radius * solid.voxel_mm;
        return Err(Refusal::Ball { radius_mm });
    }
    // Twice what a sheet of too few points holds: a tube, straight or closed, whose medial points
    // see skin all around.
    if volume > 4.0 * radius * MIN_SHEET_POINTS as f64 {
        let length = volume / (std::f64::consts::PI * radius * radius);
        return Err(Refusal::Tube { length_mm: length * solid.voxel_mm, radius_mm: radius * solid.voxel_mm });
    }
    Err(Refusal::TooSmall { points, needed: MIN_SHEET_POINTS })
}

/// Refuses balls and tubes: their medial sheet is no wider than they are thick.
fn check_extents(region: &Region, sheet: &SheetSides, solid: &Solid) -> Result<(), Refusal> {
    // The side of a rectangle is √12 times its root second moment.
    let [length, width] = region.principal_axes().1.map(|e| e * 12.0f64.sqrt());
    let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
    let mm = solid.voxel_mm;
    let (length_mm, radius_mm) = (length * mm, radius * mm);
    if length < BALL_LENGTH * radius {
        Err(Refusal::Ball { radius_mm })
    } else if width < TUBE_WIDTH * radius {
        Err(Refusal::Tube { length_mm, radius_mm })
    } else {
        Ok(())
    }
}

/// The smooth outer surface of the mask in the world.
fn object_mesh(solid: &Solid, observer: &dyn Observer) -> Result<TriangleMesh, Cancelled> {
    let mesh = zero_surface(&solid.level.0, &|| observer.check())?;
    let mut triangles = mesh.triangles;
    if solid.world_from_work.matrix().determinant() < 0.0 {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(TriangleMesh { positions: in_world(solid, &mesh.positions), triangles })
}

fn in_world(solid: &Solid, points: &[Point3<f64>]) -> Vec<WorldPoint> {
    points.iter().map(|p| solid.world_from_work.point(*p)).collect()
}

fn in_mm(points: &[Point2<f64>], voxel_mm: f64) -> Vec<ParamPoint> {
    points.iter().map(|p| ParamPoint::from(p.coords * voxel_mm)).collect()
}

/// A finished figure in the world.
fn figure(solid: &Solid, sheet: &SheetSides, draft: &Draft, observer: &dyn Observer) -> Result<Figure, Cancelled> {
    let Draft { nodes, flat, frame, automatic, repair } = draft;
    let mm = solid.voxel_mm;
    let quads = FlatQuads::from(nodes);
    let residual = PerSurface {
        medial: flat.medial.residual_variance,
        upper: flat.upper.residual_variance,
        lower: flat.lower.residual_variance,
    };
    let points = |positions: &[Point3<f64>], flat: &Flat| FlatPoints {
        positions: in_world(solid, positions),
        flat: in_mm(&flat.points, mm),
    };
    Ok(Figure {
        grid: nodes.size,
        medial: in_world(solid, &nodes.medial),
        upper: in_world(solid, &nodes.upper),
        lower: in_world(solid, &nodes.lower),
        crest: in_world(solid, &nodes.crest),
        valid: nodes.valid.clone(),
        medial_radius_mm: nodes.radii.iter().map(|r| r * mm).collect(),
        area_distortion: quads.log_ratio_per_node(),
        intrinsic: PerSurface {
            medial: in_mm(&nodes.intrinsic.medial, mm),
            upper: in_mm(&nodes.intrinsic.upper, mm),
            lower: in_mm(&nodes.intrinsic.lower, mm),
        },
        neighbors: PerSurface {
            medial: flat.medial.neighbors,
            upper: flat.upper.neighbors,
            lower: flat.lower.neighbors,
        },
        landmarks: PerSurface {
            medial: flat.medial.landmarks,
            upper: flat.upper.landmarks,
            lower: flat.lower.landmarks,
        },
        points: PerSurface {
            medial: points(&sheet.medial.positions, &flat.medial),
            upper: points(&sheet.upper.surface.positions, &flat.upper),
            lower: points(&sheet.lower.surface.positions, &flat.lower),
        },
        quality: figure_quality(nodes, &quads, residual, *repair, observer)?,
        frame: frame.clone(),
        automatic: automatic.clone(),
        uncertainty: None,
    })
}

/// Hinges between the figures that were kept.
fn junctions(solid: &Solid, surface: &MedialSurface, sheets: &Sheets, drafts: &[Option<Draft>]) -> Vec<Junction> {
    let mut number = Vec::new();
    for draft in drafts {
        number.push(draft.is_some().then(|| number.iter().flatten().count()));
    }
    let mut all = Vec::new();
    for hinge in &sheets.hinges {
        let figures: Vec<usize> = hinge.sheets.iter().filter_map(|&s| number[s as usize]).collect();
        if figures.len() > 1 {
            let points = hinge.points.iter().map(|&p| surface.points[p as usize].position).collect::<Vec<_>>();
            all.push(Junction { figures, points: in_world(solid, &points) });
        }
    }
    all
}
