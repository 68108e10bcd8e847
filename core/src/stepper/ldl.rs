//! The symmetric M×M system (JJᵀ + μ²I)·y = ΔX by LDLᵀ: what a task of 3 or 6 rows needs instead of a general
//! decomposition (Golub and Van Loan 2013, *Matrix computations*, section 4.1.2).

use crate::real::Real;

/// L (below the diagonal) and 1/D (on it) of JJᵀ + μ²I.
pub(super) struct Ldl<T, const M: usize> {
    factors: [[T; M]; M],
    /// The sum of the diagonal before it was factored: the sum of the squared singular values.
    trace: T,
}

impl<T: Real, const M: usize> Ldl<T, M> {
    #[inline(always)]
    pub fn new<const N: usize>(j: &[[T; M]; N], damping: T) -> Self {
        let mut f = [[T::zero(); M]; M];
        for r in 0..M {
            for c in 0..=r {
                for i in 0..N {
                    let part = j[i][r] * j[i][c];
                    f[r][c] = if i == 0 { part } else { f[r][c] + part };
                }
            }
        }
        let mut trace = T::zero();
        for r in 0..M {
            f[r][r] = f[r][r] + damping;
            trace = if r == 0 { f[r][r] } else { trace + f[r][r] };
        }
        for c in 0..M {
            // One division for a column: they take longest of all.
            f[c][c] = T::one() / f[c][c];
            // L[r][c]·D[c].
            let mut scaled = [T::zero(); M];
            for r in c + 1..M {
                scaled[r] = f[r][c];
                f[r][c] = scaled[r] * f[c][c];
                for k in c + 1..=r {
                    f[r][k] = f[r][k] - f[r][c] * scaled[k];
                }
            }
        }
        Ldl { factors: f, trace }
    }

    /// Whether the matrix is far enough from singular for this factorisation to be exact enough: true only where
    /// λ_min/λ_max > 3e-4, that is σ_min/σ_max > 0.017. Of M eigenvalues with sum s and product p,
    /// λ_min ≥ p·((M−1)/s)^(M−1). False where anything is NaN.
    #[inline(always)]
    pub fn is_well_conditioned(&self) -> T::Mask {
        let by = T::of(1.0 / (M as f64 - 1.0)) * self.trace;
        let mut inverse = T::one();
        for r in 0..M {
            inverse = inverse * (self.factors[r][r] * by);
        }
        // Rounding can leave a negative D where the matrix is singular, with an inverse that is large.
        inverse.abs().lt(T::of(1.0 / (3e-4 * (M as f64 - 1.0))))
    }

    /// y.
    #[inline(always)]
    pub fn solve(&self, right: &[T; M]) -> [T; M] {
        let f = &self.factors;
        let mut y = *right;
        for r in 1..M {
            for c in 0..r {
                y[r] = y[r] - f[r][c] * y[c];
            }
        }
        for r in 0..M {
            y[r] = y[r] * f[r][r];
        }
        for r in (0..M).rev() {
            for c in r + 1..M {
                y[r] = y[r] - f[c][r] * y[c];
            }
        }
        y
    }
}
