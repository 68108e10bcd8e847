//! Three numbers in space, as arrays: the few operations the hot path needs, each in a fixed order.

use crate::real::Real;

/// A point or a direction: x, y, z.
pub type Vec3<T> = [T; 3];

#[inline(always)]
pub(crate) fn add<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn sub<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn scale<T: Real>(a: Vec3<T>, k: T) -> Vec3<T> {
    [a[0] * k, a[1] * k, a[2] * k]
}

#[inline(always)]
pub(crate) fn negate<T: Real>(a: Vec3<T>) -> Vec3<T> {
    [-a[0], -a[1], -a[2]]
}

#[inline(always)]
pub(crate) fn cross<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The inner product of two columns, summed from the first row down.
#[inline(always)]
pub(crate) fn dot<T: Real, const M: usize>(a: &[T; M], b: &[T; M]) -> T {
    let mut sum = T::zero();
    for r in 0..M {
        sum = if r == 0 {
            a[r] * b[r]
        } else {
            sum + a[r] * b[r]
        };
    }
    sum
}

/// The distance between two points.
#[inline(always)]
pub(crate) fn distance<T: Real>(a: Vec3<T>, b: Vec3<T>) -> T {
    let d = sub(a, b);
    dot(&d, &d).sqrt()
}
