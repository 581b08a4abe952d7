//! Conversion between a robot's graph and its messages: what it shares and its estimate, as numbers and back.

use crate::envelope::Refused;
use crate::graphs::Measurement;
use crate::message::{Estimate, Shared};
use crate::{PoseId, RobotId};
use cairn_geometry::LieGroup;
use cairn_solve::graph::{Condensed, semi_definite};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::collections::BTreeMap;

/// What a robot shares, decoded.
#[derive(Clone, Debug)]
pub struct SharedGraph<G, const D: usize> {
    /// The shared poses, in rising order.
    pub ids: Vec<PoseId>,
    /// Measurements between them.
    pub inner: Vec<Measurement<G, D>>,
    /// Loops to other robots.
    pub loops: Vec<Measurement<G, D>>,
    /// The poses around each eliminated part, as indices of shared poses.
    pub parts: Vec<Vec<usize>>,
}

/// The estimate of a robot, decoded.
#[derive(Clone, Debug)]
pub struct Located<G, const D: usize> {
    /// `world_from_pose` of the shared poses.
    pub poses: Vec<G>,
    /// The condensed parts; their vertices are indices of shared poses.
    pub parts: Vec<Condensed<G, D>>,
}

/// Collects information matrices so that equal ones are sent once.
#[derive(Default)]
struct Informations {
    numbers: Vec<f64>,
    places: BTreeMap<Vec<u64>, u16>,
}

impl Informations {
    /// The index of a matrix; `None` when there are too many different ones.
    fn place<const D: usize>(&mut self, m: &SMatrix<f64, D, D>) -> Option<u16> {
        let upper: Vec<f64> = (0..D).flat_map(|r| (r..D).map(move |c| m[(r, c)])).collect();
        let key = upper.iter().map(|v| v.to_bits()).collect();
        let next = u16::try_from(self.places.len()).ok()?;
        let place = *self.places.entry(key).or_insert(next);
        if place == next {
            self.numbers.extend(upper);
        }
        Some(place)
    }
}

/// What is shared, as numbers; `None` when it is too much for a message. Poses are given by their index in `seqs`.
pub fn encode_shared<G: LieGroup<D>, const D: usize>(
    robot: RobotId,
    seqs: &[u32],
    inner: &[Measurement<G, D>],
    loops: &[Measurement<G, D>],
    parts: &[Vec<usize>],
) -> Option<Shared> {
    let place = |id: PoseId| u16::try_from(seqs.binary_search(&id.seq).ok()?).ok();
    let end = |m: &Measurement<G, D>| {
        let (own, other) = m.own_end(robot)?;
        Some((place(own)?, other, other == m.a))
    };
    let steps = seqs.iter().scan(0, |last, seq| Some(seq - std::mem::replace(last, *seq))).collect();
    let mut informations = Informations::default();
    let all = || inner.iter().chain(loops);
    let information = all().map(|m| informations.place(&m.information)).collect::<Option<_>>()?;
    Some(Shared {
        steps,
        inner: inner.iter().map(|m| Some((place(m.a)?, place(m.b)?))).collect::<Option<_>>()?,
        loops: loops.iter().map(end).collect::<Option<_>>()?,
        measured: all().flat_map(|m| -> [f64; D] { m.a_from_b.coordinates().into() }).collect(),
        information,
        informations: informations.numbers,
        parts: parts.iter().map(|p| p.iter().map(|k| *k as u16).collect()).collect(),
    })
}

/// What is shared, from a message that was already checked.
///
/// # Errors
/// [`Refused::Inconsistent`] when an information matrix is not positive semi-definite.
pub fn decode_shared<G: LieGroup<D>, const D: usize>(
    robot: RobotId,
    shared: &Shared,
) -> Result<SharedGraph<G, D>, Refused> {
    let mut seq = 0;
    let ids: Vec<PoseId> = shared
        .steps
        .iter()
        .map(|step| {
            seq += step;
            PoseId { robot, seq }
        })
        .collect();
    let matrices: Vec<SMatrix<f64, D, D>> =
        shared.informations.chunks_exact(D * (D + 1) / 2).map(symmetric).collect();
    if !matrices.iter().all(semi_definite) {
        return Err(Refused::Inconsistent("an information matrix is not positive semi-definite"));
    }
    let inner = shared.inner.iter().map(|(a, b)| (ids[usize::from(*a)], ids[usize::from(*b)]));
    let loops = shared.loops.iter().map(|(own, other, is_first)| {
        let own = ids[usize::from(*own)];
        if *is_first { (*other, own) } else { (own, *other) }
    });
    let mut measurements: Vec<Measurement<G, D>> = inner
        .chain(loops)
        .zip(shared.measured.chunks_exact(D))
        .zip(&shared.information)
        .map(|(((a, b), numbers), k)| {
            let a_from_b = G::identity().retract(&SVector::from_column_slice(numbers));
            Measurement { a, b, a_from_b, information: matrices[usize::from(*k)] }
        })
        .collect();
    let loops = measurements.split_off(shared.inner.len());
    let parts = shared.parts.iter().map(|p| p.iter().map(|k| usize::from(*k)).collect()).collect();
    Ok(SharedGraph { ids, inner: measurements, loops, parts })
}

fn symmetric<const D: usize>(upper: &[f64]) -> SMatrix<f64, D, D> {
    let mut m = SMatrix::zeros();
    let places = (0..D).flat_map(|r| (r..D).map(move |c| (r, c)));
    for ((r, c), v) in places.zip(upper) {
        (m[(r, c)], m[(c, r)]) = (*v, *v);
    }
    m
}

/// The poses as numbers, and the rounded poses that receivers will read from them.
pub fn encode_poses<G: LieGroup<D>, const D: usize>(poses: &[G]) -> (Estimate, Vec<G>) {
    let mut estimate = Estimate::default();
    if let Some((first, others)) = poses.split_first() {
        estimate.first = first.coordinates().iter().copied().collect();
        let from_first = first.inverse();
        let relative = others.iter().map(|p| -> [f64; D] { from_first.compose(p).coordinates().into() });
        estimate.others = relative.flatten().map(|v| v as f32).collect();
    }
    let read = decode_poses(&estimate);
    (estimate, read)
}

fn decode_poses<G: LieGroup<D>, const D: usize>(estimate: &Estimate) -> Vec<G> {
    if estimate.first.len() != D {
        return Vec::new();
    }
    let first = G::identity().retract(&SVector::from_column_slice(&estimate.first));
    let others = estimate.others.chunks_exact(D).map(|numbers| {
        let coordinates = SVector::<f64, D>::from_fn(|k, _| f64::from(numbers[k]));
        first.compose(&G::identity().retract(&coordinates))
    });
    std::iter::once(first).chain(others).collect()
}

/// Appends the numbers of a condensed part.
pub fn encode_part<G: LieGroup<D>, const D: usize>(part: &Condensed<G, D>, numbers: &mut Vec<f32>) {
    let n = part.rhs().len();
    numbers.extend((0..n).flat_map(|r| (r..n).map(move |c| part.root()[(r, c)] as f32)));
    numbers.extend(part.rhs().iter().map(|v| *v as f32));
}

/// The estimate of a robot, from a message that fits what the robot shares.
///
/// # Errors
/// [`Refused::Inconsistent`] when a pose or a condensed part is not finite.
pub fn decode_estimate<G: LieGroup<D>, const D: usize>(
    estimate: &Estimate,
    around: &[Vec<usize>],
) -> Result<Located<G, D>, Refused> {
    let poses: Vec<G> = decode_poses(estimate);
    if !poses.iter().all(|p| p.is_finite()) {
        return Err(Refused::Inconsistent("a pose of the estimate is not finite"));
    }
    let mut numbers = estimate.parts.iter().map(|v| f64::from(*v));
    let mut parts = Vec::with_capacity(around.len());
    for vertices in around {
        let n = D * (vertices.len() - 1);
        let mut root = DMatrix::zeros(n, n);
        for r in 0..n {
            for c in r..n {
                root[(r, c)] = numbers.next().unwrap_or(f64::NAN);
            }
        }
        let rhs = DVector::from_iterator(n, numbers.by_ref().take(n));
        let from_base = poses[vertices[0]].inverse();
        let relative = vertices[1..].iter().map(|v| from_base.compose(&poses[*v])).collect();
        let part = Condensed::new(vertices.clone(), relative, root, rhs);
        parts.push(part.map_err(|_| Refused::Inconsistent("a condensed part is not finite"))?);
    }
    Ok(Located { poses, parts })
}
