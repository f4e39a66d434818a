"""What a user of cameras may turn."""

from dataclasses import dataclass

from odm.cameras._remember import GO_FREE, GO_OCCUPIED, GO_ON
from roadmap.errors import BadInput
from roadmap.ranges import CheckedSettings, setting, told

POLICIES = {"free": GO_FREE, "occupied": GO_OCCUPIED, "keep": GO_ON}
LARGEST_D_SELF = 0.01  # [m]


@dataclass(frozen=True)
class SeenSettings(CheckedSettings):
    """Settings of the camera cells: what unseen cells are, which readings are dropped.

    Attributes:
        memory_s: How long a cell that no camera sees keeps its last content [s].
        speed: Speed at which that content may spread into other unseen cells [m/s].
        policy: What unseen cells are after that: "free", "occupied" (also cells never
            seen, but for those around the robot itself) or "keep" (their content).
        shadow: What lies behind a seen surface counts as occupied.
        d_self: Self filter: points within this distance of a cover sphere are taken
            for the robot and removed, at most 0.01 [m]; None: no filter. Nothing is
            proved within this distance.
        flying_m: Filter of flying pixels: a reading that lies between its neighbours
            and is farther than this from both is removed [m]; None: no filter. It
            weakens the proof: a steep surface looks the same.
        noise_m: Largest amount by which a reading may exceed the true depth, beyond the
            map's sensor share [m].
        max_range_m: Where no reading lies in the grid and the middle one is farther
            than this, the camera's scale is wrong: the frame is unfit [m].
    """

    memory_s: float = setting(0.3, 0.0, 60.0, "s")
    speed: float = setting(1.6, 0.0, 20.0, "m/s")
    policy: str = "free"
    shadow: bool = True
    d_self: float | None = setting(None, 0.0, LARGEST_D_SELF, "m")
    flying_m: float | None = setting(None, 0.001, 1.0, "m")
    noise_m: float = setting(0.0, 0.0, 0.1, "m")
    max_range_m: float = setting(20.0, 0.1, 1000.0, "m")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.policy, str) and self.policy in POLICIES):
            raise BadInput(
                f"the policy {told(self.policy)} is unknown; choose one of "
                f"{', '.join(POLICIES)}"
            )

    @property
    def policy_code(self) -> int:
        """The policy for compiled loops."""
        return POLICIES[self.policy]
