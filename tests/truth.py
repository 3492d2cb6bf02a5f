"""The true causes of pure manipulation on the kinematic backend, which kinematic.py derives in closed form."""

TRUTH = {
    1: {"r_eefx": {"army"}, "r_eefy": {"armx"}, "r_eefz1": {"armx", "armz"}, "r_gripper": {"grip"}},
    2: {"r_ori": {"armrx", "armry"}, "r_gripper": {"grip"}},
    3: {"r_eefz2": {"armz"}, "r_gripper": {"grip"}},
    4: {"r_gripper": {"grip"}},
}
