// A coarse notched beam of hexahedra with the groups that knothe reads:  gmsh -3 beam.geo -format msh41 -o beam41.msh
SetFactory("Built-in");
Mesh.ElementOrder = 1;
// Planes x = const of the beam from mid-span; the notch is |x| < 5 mm, y < 20 mm. Coordinates in m.
x[] = {-0.42, -0.4, -0.055, -0.015, -0.005, 0.005, 0.015, 0.055, 0.4, 0.42};
y[] = {0, 0.02, 0.09, 0.1};
nx[] = {1, 8, 4, 1, 1, 1, 4, 8, 1};
ny[] = {2, 7, 1};
For i In {0:9}
  For j In {0:3}
    Point(10*i + j + 1) = {x[i], y[j], 0};
  EndFor
EndFor
For i In {0:8}
  For j In {0:3}
    Line(1000 + 10*i + j) = {10*i + j + 1, 10*(i+1) + j + 1};
    Transfinite Curve {1000 + 10*i + j} = nx[i] + 1;
  EndFor
EndFor
For i In {0:9}
  For j In {0:2}
    Line(2000 + 10*i + j) = {10*i + j + 1, 10*i + j + 2};
    Transfinite Curve {2000 + 10*i + j} = ny[j] + 1;
  EndFor
EndFor
elastic[] = {};
damageable[] = {};
symmetry[] = {};
For i In {0:8}
  For j In {0:2}
    If (i != 4 || j > 0)
      s = 3000 + 10*i + j;
      Curve Loop(s) = {1000 + 10*i + j, 2000 + 10*(i+1) + j, -(1000 + 10*i + j + 1), -(2000 + 10*i + j)};
      Plane Surface(s) = {s};
      Transfinite Surface {s};
      Recombine Surface {s};
      symmetry[] += {s};
    EndIf
  EndFor
EndFor
For i In {0:8}
  For j In {0:2}
    If (i != 4 || j > 0)
      s = 3000 + 10*i + j;
      out[] = Extrude {0, 0, 0.05} { Surface{s}; Layers{1}; Recombine; };
      If (i < 2 || i > 6 || (j == 2 && i > 2 && i < 6))
        elastic[] += {out[1]};
      Else
        damageable[] += {out[1]};
      EndIf
      If (j == 2 && i == 4)
        load = out[4];
      EndIf
      If (j == 0 && i == 1)
        left = out[2];
      EndIf
      If (i == 0)
        face~{j} = out[5];
      EndIf
    EndIf
  EndFor
EndFor
Physical Volume("elastic") = elastic[];
Physical Volume("concrete") = damageable[];
Physical Surface("symmetry") = symmetry[];
Physical Surface("load") = {load};
Physical Surface("left_face") = {face_0, face_1, face_2};
// The lines x = ±0.4, y = 0 across the thickness.
left_line[] = Curve In BoundingBox {-0.4 - 1e-6, -1e-6, -1e-6, -0.4 + 1e-6, 1e-6, 0.05 + 1e-6};
right_line[] = Curve In BoundingBox {0.4 - 1e-6, -1e-6, -1e-6, 0.4 + 1e-6, 1e-6, 0.05 + 1e-6};
Physical Curve("support_left") = left_line[];
Physical Curve("support_right") = right_line[];
