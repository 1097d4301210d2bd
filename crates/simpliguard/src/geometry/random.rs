//! Random numbers that are the same on every machine.

use glam::Quat;

/// A small generator whose sequence is the same on every machine (xorshift64*, Vigna 2016).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A generator; every seed is allowed.
    pub fn new(seed: u64) -> Self {
        Self(seed ^ 0x9E37_79B9_7F4A_7C15)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if self.0 == 0 {
            self.0 = 0x9E37_79B9_7F4A_7C15;
        }
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// A number, uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// A rotation, uniform over the unit quaternions (Shoemake 1992).
    pub fn rotation(&mut self) -> Quat {
        let (u, a, b) = (self.unit(), self.unit() * std::f32::consts::TAU, self.unit() * std::f32::consts::TAU);
        let (r, s) = ((1.0 - u).sqrt(), u.sqrt());
        Quat::from_xyzw(r * libm::sinf(a), r * libm::cosf(a), s * libm::sinf(b), s * libm::cosf(b)).normalize()
    }
}
