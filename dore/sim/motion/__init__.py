"""How the arm moves: kinematics, collisions, validated motions."""
