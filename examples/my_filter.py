"""Contact estimator in about a hundred lines: a bank of extended Kalman filters for a contact at rest in space.

    whisker evaluate datasets/standard --exec "python examples/my_filter.py"

A single reading cannot distinguish a light push near the tip from a firm one near the root. Each contact therefore begins with one
hypothesis per calibrated position along the whisker that explains the reading. Each hypothesis is a Kalman filter, weighted by its
marginal likelihood. `docs/your-estimator.md` specifies the lines that are read and written.
"""

import json
import sys

import numpy as np

PROCESS_SD_M = 4e-6  # standard deviation of the contact's random walk per row, because a pin is not a point
LEAST_WEIGHT = 1e-15  # hypotheses with smaller weights are discarded
ANSWER = (
    *("contact_x_m", "contact_y_m"),
    *("cov_xx_m2", "cov_xy_m2", "cov_yy_m2"),
    *("innovation_n_m", "innovation_variance_n2_m2"),
)


class Side:
    """Sensor model of one side of the whisker, from its table of n nodes."""

    def __init__(self, calibrated: dict):
        table = {name: np.array(column) for name, column in calibrated["table"].items()}
        self.shape = calibrated["shape"]
        self.places_m = np.stack([table["x_m"], table["y_m"]], axis=-1)
        self.readings_n_m = table["reading_n_m"]
        self.gradients_n = np.stack([table["gradient_x_n"], table["gradient_y_n"]], axis=-1)
        self.variances_n2_m2 = table["model_sd_n_m"] ** 2

    def expect(self, contacts_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted readings (k,), their gradients (k, 2) and the model's variances (k,) at contacts (k, 2) in Base.

        Linear about the nearest node.
        """
        offsets_m = contacts_m[:, None] - self.places_m
        node = np.argmin((offsets_m**2).sum(axis=-1), axis=1)
        offset_m, gradient_n = offsets_m[np.arange(len(node)), node], self.gradients_n[node]
        return self.readings_n_m[node] + (gradient_n * offset_m).sum(axis=-1), gradient_n, self.variances_n2_m2[node]

    def hypotheses(self, reading_n_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Contacts (k, 2) in Base that explain a reading, one per arc length, and their covariances (k, 2, 2).

        The standard deviation of each extends to the next contact.
        """
        off_n_m = np.abs(self.readings_n_m - reading_n_m).reshape(self.shape)
        node = np.arange(self.shape[0]) * self.shape[1] + np.argmin(off_n_m, axis=1)
        gradients_n = self.gradients_n[node]
        step_m = (reading_n_m - self.readings_n_m[node]) / (gradients_n**2).sum(axis=-1)
        contacts_m = self.places_m[node] + step_m[:, None] * gradients_n
        along_m = np.gradient(contacts_m, axis=0)
        return contacts_m, along_m[:, :, None] * along_m[:, None]


class Bank:
    """Kalman filters for the contact in the frame of the first row, weighted by their marginal likelihoods."""

    def __init__(self, side: Side, row: dict, noise_sd_n_m: float):
        self.side, self.noise_sd_n_m = side, noise_sd_n_m
        contacts_m, covariances_m2 = side.hypotheses(row["reading_n_m"])
        origin_m, turn = base(row)
        self.means_m = contacts_m @ turn.T + origin_m
        self.covariances_m2 = turn @ covariances_m2 @ turn.T + 1e-5**2 * np.eye(2)
        self.log_weights = np.zeros(len(contacts_m))

    def step(self, row: dict) -> dict:
        """Processes a row; returns the estimate of the contact in Base."""
        origin_m, turn = base(row)
        self.covariances_m2 += PROCESS_SD_M**2 * np.eye(2)
        expected_n_m, gradients_n, variances_n2_m2 = self.side.expect((self.means_m - origin_m) @ turn)
        gradients_n = gradients_n @ turn.T
        spread = np.einsum("kij,kj->ki", self.covariances_m2, gradients_n)
        variance_n2_m2 = (spread * gradients_n).sum(axis=-1) + self.noise_sd_n_m**2 + variances_n2_m2
        residual_n_m = row["reading_n_m"] - expected_n_m
        innovation = mixture(self.weights(), residual_n_m[:, None], variance_n2_m2[:, None, None])

        gains = spread / variance_n2_m2[:, None]
        self.means_m += gains * residual_n_m[:, None]
        self.covariances_m2 -= gains[:, :, None] * spread[:, None]
        self.log_weights -= 0.5 * (residual_n_m**2 / variance_n2_m2 + np.log(variance_n2_m2))
        keep = self.weights() > LEAST_WEIGHT
        self.means_m, self.covariances_m2 = self.means_m[keep], self.covariances_m2[keep]
        self.log_weights = self.log_weights[keep]

        mean_m, covariance_m2 = mixture(self.weights(), self.means_m, self.covariances_m2)
        contact_m, covariance_m2 = turn.T @ (mean_m - origin_m), turn.T @ covariance_m2 @ turn
        answer = [*contact_m, *covariance_m2[np.triu_indices(2)], *innovation[0], *innovation[1][0]]
        return dict(zip(ANSWER, map(float, answer), strict=True))

    def weights(self) -> np.ndarray:
        """Probabilities of the hypotheses (k,)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return weights / weights.sum()


def mixture(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of a mixture of Gaussians with means (k, n) and covariances (k, n, n)."""
    mean = weights @ means
    offsets = means - mean
    return mean, np.tensordot(weights, covariances + offsets[:, :, None] * offsets[:, None], axes=1)


def base(row: dict) -> tuple[np.ndarray, np.ndarray]:
    """Origin (2,) and rotation (2, 2) of Base in the frame of the first row."""
    cos, sin = np.cos(row["base_yaw_rad"]), np.sin(row["base_yaw_rad"])
    return np.array([row["base_x_m"], row["base_y_m"]]), np.array([[cos, -sin], [sin, cos]])


def main() -> None:
    """Answers each row with one line."""
    known = json.loads(sys.stdin.readline())
    if known["protocol"] != 1:
        sys.exit(f"protocol: found {known['protocol']}, expected 1")
    sides = {calibrated["face"]: Side(calibrated) for calibrated in known["faces"]}
    bank = None
    for line in sys.stdin:
        row = json.loads(line)
        side = sides.get(row["touched"])
        if side is None:
            bank = None
        elif bank is None:
            bank = Bank(side, row, known["noise_sd_n_m"])
        print(json.dumps(bank and bank.step(row)), flush=True)


if __name__ == "__main__":
    main()
