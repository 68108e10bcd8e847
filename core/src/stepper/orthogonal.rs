//! The singular value decomposition of a Jacobian of M rows, by one-sided Jacobi rotations of its rows.
//!
//! J = U·Σ·Vᵀ: rotations from the left make the rows orthogonal, Uᵀ·J = Σ·Vᵀ, so that row k is σₖ·vₖᵀ, and the same
//! rotations turn ΔX into Uᵀ·ΔX, which is all a step needs (Hestenes 1958; Golub and Van Loan 2013, section 8.6.3).
//! It never squares J, so a σ of 1e-4·σ_max is told from 0 in `f32` too. Lanes that are done rotate by 0.

use crate::real::Real;

/// Sweeps over all pairs of rows: 4 to 6 settle every Jacobian tried in `f32`, 7 in `f64`.
const MOST_SWEEPS: usize = 10;

/// Uᵀ·J and Uᵀ·ΔX.
pub(super) struct Orthogonal<T, const M: usize, const N: usize> {
    /// Columns of Uᵀ·J: `rows[i][k]` is σₖ·vₖ at DoF i.
    pub rows: [[T; M]; N],
    /// Uᵀ·ΔX.
    pub error: [T; M],
    /// σₖ².
    pub squares: [T; M],
    /// The greatest σ².
    pub most: T,
}

impl<T: Real, const M: usize, const N: usize> Orthogonal<T, M, N> {
    #[inline(always)]
    pub fn new(j: &[[T; M]; N], error: &[T; M]) -> Self {
        let (mut rows, mut error) = (*j, *error);
        // Rows whose cosine is below this are orthogonal.
        let tolerance = T::of(64.0 * T::EPSILON * T::EPSILON);
        for _sweep in 0..MOST_SWEEPS {
            let mut turned = false;
            for p in 0..M {
                for q in p + 1..M {
                    turned |= rotate(&mut rows, &mut error, p, q, tolerance);
                }
            }
            if !turned {
                break;
            }
        }
        let mut squares = [T::zero(); M];
        let mut most = T::zero();
        for k in 0..M {
            squares[k] = inner(&rows, k, k);
            most = squares[k].most(most);
        }
        Orthogonal {
            rows,
            error,
            squares,
            most,
        }
    }

    /// Whether σₖ is not below 1e-4·σ_max.
    #[inline(always)]
    pub fn counts(&self, k: usize) -> T::Mask {
        (T::of(1e-8) * self.most).lt(self.squares[k])
    }
}

/// The inner product of rows p and q.
#[inline(always)]
fn inner<T: Real, const M: usize, const N: usize>(rows: &[[T; M]; N], p: usize, q: usize) -> T {
    let mut sum = T::zero();
    for i in 0..N {
        let part = rows[i][p] * rows[i][q];
        sum = if i == 0 { part } else { sum + part };
    }
    sum
}

/// Makes rows p and q orthogonal, if they are not; whether it had to.
#[inline(always)]
fn rotate<T: Real, const M: usize, const N: usize>(
    rows: &mut [[T; M]; N],
    error: &mut [T; M],
    p: usize,
    q: usize,
    tolerance: T,
) -> bool {
    let (one, two) = (T::one(), T::of(2.0));
    let (a, b, c) = (inner(rows, p, p), inner(rows, q, q), inner(rows, p, q));
    let needed = (tolerance * (a * b)).lt(c * c);
    if !T::any(needed) {
        return false;
    }
    // tan of the angle: the smaller root of t² + 2ζt − 1 = 0.
    let zeta = (b - a) / (two * T::select(needed, c, one));
    let root = one / (zeta.abs() + (one + zeta * zeta).sqrt());
    let tangent = T::select(zeta.lt(T::zero()), -root, root);
    let tangent = T::select(needed, tangent, T::zero());
    let cos = one / (one + tangent * tangent).sqrt();
    let sin = cos * tangent;
    for i in 0..N {
        let (x, y) = (rows[i][p], rows[i][q]);
        rows[i][p] = cos * x - sin * y;
        rows[i][q] = sin * x + cos * y;
    }
    let (x, y) = (error[p], error[q]);
    error[p] = cos * x - sin * y;
    error[q] = sin * x + cos * y;
    true
}
