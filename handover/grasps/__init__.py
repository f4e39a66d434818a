"""How an object can be grasped: agents and hands, objects, and sets of grasps."""
