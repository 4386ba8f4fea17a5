//! Seeds of independent random number streams.

use files::Digest;

/// Seed that depends only on the run's seed and on the words that name its purpose, so that it is independent of order and threads.
pub fn derived_seed(seed: u64, purpose: &[&str]) -> u64 {
    let mut digest = Digest::default();
    digest.add(seed.to_le_bytes());
    for word in purpose {
        digest.add(word);
    }
    u64::from_str_radix(&digest.finish()[..16], 16).expect("a hash is hexadecimal")
}
