//! Numbers in a few words.

/// The value up to which `percent` of the others lie, of values in ascending order (nearest rank, rounded down); `None`
/// without values.
#[must_use]
pub fn percentile(ascending: &[f64], percent: usize) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    Some(ascending[last * percent.min(100) / 100])
}

/// The middle value, of two the larger; `None` without values.
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Mean; `None` without values.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    if values.is_empty() { None } else { Some(values.iter().sum::<f64>() / values.len() as f64) }
}

/// Sample standard deviation; `None` of fewer than two values.
#[must_use]
pub fn deviation(values: &[f64]) -> Option<f64> {
    let mean = mean(values).filter(|_| values.len() > 1)?;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    Some((square / (values.len() as f64 - 1.0)).sqrt())
}

/// Values of which each stands for a share of the whole, its weight.
#[derive(Clone, Debug, Default)]
pub struct Weighted {
    /// Pairs of a value and its weight, by value.
    ascending: Vec<(f64, f64)>,
    total: f64,
}

impl Weighted {
    /// Of pairs of a value and its weight, which must not be negative; `None` when all weights together are nothing.
    #[must_use]
    pub fn new(mut pairs: Vec<(f64, f64)>) -> Option<Self> {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total = pairs.iter().map(|(_, weight)| weight).sum();
        (total > 0.0).then_some(Self { ascending: pairs, total })
    }

    /// Mean.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.ascending.iter().map(|(value, weight)| value * weight).sum::<f64>() / self.total
    }

    /// Standard deviation of the whole.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        let mean = self.mean();
        let square: f64 = self.ascending.iter().map(|(value, weight)| (value - mean).powi(2) * weight).sum();
        (square / self.total).sqrt()
    }

    /// The smallest value up to which this share of the weight lies.
    #[must_use]
    pub fn percentile(&self, share: f64) -> f64 {
        let mut below = 0.0;
        for (value, weight) in &self.ascending {
            below += weight;
            if below >= share * self.total {
                return *value;
            }
        }
        self.ascending[self.ascending.len() - 1].0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_are_there() {
        let values: Vec<f64> = (0..=20).map(f64::from).collect();
        assert_eq!([0, 5, 50, 95, 100].map(|p| percentile(&values, p)), [0.0, 1.0, 10.0, 19.0, 20.0].map(Some));
        assert_eq!(percentile(&[], 50), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0, 9.0]), Some(3.0));
    }

    #[test]
    fn a_deviation_needs_two_values() {
        assert_eq!(deviation(&[2.0]), None);
        assert_eq!(deviation(&[1.0, 3.0]), Some(2.0f64.sqrt()));
    }

    #[test]
    fn a_value_counts_as_much_as_its_weight() {
        let weighted = Weighted::new(vec![(4.0, 4.0), (1.0, 0.5), (2.0, 4.5)]).expect("it has weight");
        let mean = (0.5 + 9.0 + 16.0) / 9.0;
        assert!((weighted.mean() - mean).abs() < 1e-12);
        assert_eq!([0.05, 0.5, 0.95].map(|share| weighted.percentile(share)), [1.0, 2.0, 4.0]);
        assert!(Weighted::new(vec![(1.0, 0.0)]).is_none() && Weighted::new(Vec::new()).is_none());
    }
}
