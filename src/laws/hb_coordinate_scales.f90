!> Scales of coordinates, in which amperes, pascals and metres may be compared, whatever the units of a coordinate, of an equation
!> and of time.
!>
!> Where two coordinates act on each other, their equations are multiplied so that both actions have one magnitude: those of a
!> symmetric structure, or of a coil and its circuit, are then powers, and every coordinate is measured by its energy at the slowest
!> tone, x**2 (|K| + w |D| + w**2 |M|) of its own equation. Coordinates that act on each other through laws alone are measured by
!> their own motion. Pairs are joined in the order of the strength of their coupling, as in the algorithm of R. C. Prim, Bell System
!> Technical Journal 36 (1957) 1389-1401.
module hb_coordinate_scales
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_law, only: law_box_t
   use hb_structure, only: max_dense, structure_t
   implicit none
   private
   public :: coordinate_scales_t, find_compliances, find_coordinate_scales

   type :: coordinate_scales_t
      real(wp), allocatable :: coordinates(:)                         !! (n_dofs), each in the unit of its coordinate
      real(wp), allocatable :: equations(:)                           !! factors with which forces are reciprocal, (n_dofs)
   contains
      procedure :: scaled_structure => coordinate_scales_structure
      procedure :: scaled_laws => coordinate_scales_laws
   end type coordinate_scales_t

contains

   !> Scales of all coordinates. Those of a structure without dense matrices, and under laws that stand for many, are all 1.
   pure subroutine find_coordinate_scales(self, structure, laws, omega, extent)
      type(coordinate_scales_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)                          !! on its degrees of freedom
      real(wp), intent(in) :: omega                                   !! of the slowest tone [rad/s], > 0
      real(wp), intent(in) :: extent(:)                               !! of the motion of each coordinate, (n_dofs)
      real(wp), allocatable :: magnitude(:, :)
      real(wp) :: own(structure%n_dofs)
      integer :: group(structure%n_dofs), i, n

      n = structure%n_dofs
      self%coordinates = spread(1.0_wp, 1, n)
      self%equations = self%coordinates
      if (n < 2 .or. n > max_dense .or. .not. allocated(structure%stiffness)) return
      if (any([(allocated(laws(i)%law%positions), i=1, size(laws))])) return
      magnitude = abs(structure%stiffness) + omega*abs(structure%damping) + omega**2*abs(structure%mass)
      own = [(magnitude(i, i), i=1, n)]
      call make_reciprocal(magnitude, own, self%equations, group)
      call join_by_laws(laws, self%equations, group)
      if (any(group /= group(1))) call measure_by_motion(own*extent**2, self%equations, group)
      where (own > 0.0_wp)
         self%coordinates = 1.0_wp/sqrt(self%equations*own)
      elsewhere (extent > 0.0_wp)
         self%coordinates = extent
      end where
      self%coordinates = set_exponent(1.0_wp, exponent(self%coordinates)) ! a power of two changes no digit
   end subroutine find_coordinate_scales

   !> Compliances of a structure to forces that grow as exp(omega t) at some of its coordinates, with the factors of equations of
   !> find_coordinate_scales: of a passive structure they are positive and without resonances, because all its poles are in the
   !> other half-plane. Coordinates of different groups act on each other neither through the structure nor along a law.
   subroutine find_compliances(structure, coordinates, laws, omega, compliance, group)
      type(structure_t), intent(in) :: structure                      !! with dense matrices
      type(coordinates_t), intent(in) :: coordinates
      type(law_box_t), intent(in) :: laws(:)                          !! on these
      real(wp), intent(in) :: omega                                   !! [rad/s], >= 0
      real(wp), intent(out) :: compliance(:, :)                       !! (coordinates%n, coordinates%n)
      integer, intent(out) :: group(:)                                !! (coordinates%n)
      real(wp) :: factors(coordinates%n), first(coordinates%n), own(structure%n_dofs), of_equations(structure%n_dofs)
      real(wp), allocatable :: forces(:, :), magnitude(:, :), shape(:, :), weights(:), z(:, :)
      integer, allocatable :: at(:)
      integer :: group_of(structure%n_dofs), i, info, k, pivots(structure%n_dofs)

      associate (n => structure%n_dofs, n_all => coordinates%n)
         allocate (magnitude, source=abs(structure%stiffness) + omega*abs(structure%damping) + omega**2*abs(structure%mass))
         own = [(magnitude(i, i), i=1, n)]
         of_equations = 1.0_wp
         call make_reciprocal(magnitude, own, of_equations, group_of)
         allocate (shape(n, n_all), source=0.0_wp)
         do k = 1, n_all
            call coordinates%find_functional(k, at, weights)
            at = coordinates%dofs(at)
            shape(at, k) = weights
            do i = 2, size(at)
               call join(at(1), at(i), of_equations, group_of)
            end do
         end do
         where (.not. own > 0.0_wp) own = 1.0_wp/of_equations         ! an equation of couplings alone
         own = 1.0_wp/sqrt(of_equations*own)                          ! of coordinates with a diagonal of 1
         allocate (z, source=structure%stiffness + omega*structure%damping + omega**2*structure%mass)
         do i = 1, n
            z(i, i) = magnitude(i, i)
            z(:, i) = own*of_equations*z(:, i)*own(i)
         end do
         do k = 1, n_all
            shape(:, k) = own*shape(:, k)
         end do
         allocate (forces, source=shape)
         call dgetrf(n, n, z, n, pivots, info)
         if (info == 0) call dgetrs("N", n, n_all, z, n, pivots, forces, n, info)
         if (info /= 0 .or. .not. all(ieee_is_finite(forces))) forces = shape
         compliance = matmul(transpose(shape), forces)
         do k = 1, n_all
            i = findloc(abs(shape(:, k)) > 0.0_wp, .true., dim=1)
            first(k) = of_equations(i)
            group(k) = group_of(i)
         end do
      end associate
      factors = first
      call join_by_laws(laws, factors, group)
      do k = 1, size(group)
         compliance(:, k) = compliance(:, k)*sqrt(first*first(k)/(factors*factors(k)))
      end do
   end subroutine find_compliances

   !> Factors of equations with which the strongest couplings act equally in both directions; coordinates that are not coupled are
   !> in different groups.
   pure subroutine make_reciprocal(magnitude, own, factors, group)
      real(wp), intent(in) :: magnitude(:, :)                         !! of forces, row by column, (n, n)
      real(wp), intent(in) :: own(:)                                  !! its diagonal, (n)
      real(wp), intent(inout) :: factors(:)
      integer, intent(out) :: group(:)
      real(wp) :: strength, strongest(size(own))                      ! of the coupling to a coordinate that has its factor
      integer :: from(size(own)), i, k, n_done, n_groups
      logical :: is_done(size(own))

      is_done = .false.
      strongest = 0.0_wp
      from = 0
      n_groups = 0
      do n_done = 1, size(own)
         i = maxloc(strongest, dim=1, mask=.not. is_done)
         if (strongest(i) > 0.0_wp) then
            group(i) = group(from(i))
            factors(i) = factors(from(i))*magnitude(from(i), i)/magnitude(i, from(i))
         else
            n_groups = n_groups + 1
            group(i) = n_groups
         end if
         is_done(i) = .true.
         do k = 1, size(own)
            if (is_done(k) .or. .not. min(magnitude(i, k), magnitude(k, i)) > 0.0_wp) cycle
            strength = sqrt(magnitude(i, k)/max(own(i), tiny(1.0_wp)))*sqrt(magnitude(k, i)/max(own(k), tiny(1.0_wp)))
            if (strength <= strongest(k)) cycle
            strongest(k) = strength
            from(k) = i
         end do
      end do
   end subroutine make_reciprocal

   !> Joins groups on which one force acts, or the forces of one potential: a law between two bodies pushes both.
   pure subroutine join_by_laws(laws, factors, group)
      type(law_box_t), intent(in) :: laws(:)
      real(wp), intent(inout) :: factors(:)
      integer, intent(inout) :: group(:)
      integer :: c, first, i, k

      do i = 1, size(laws)
         associate (dofs => laws(i)%law%dofs, shape => laws(i)%law%shape)
            do c = 1, size(shape, 2)
               first = findloc(abs(shape(:, c)) > 0.0_wp, .true., dim=1)
               do k = 1, size(dofs)
                  if (abs(shape(k, c)) > 0.0_wp .or. laws(i)%law%has_potential) call join(dofs(first), dofs(k), factors, group)
               end do
            end do
         end associate
      end do
   end subroutine join_by_laws

   !> Joins the groups of two coordinates, whose factors become equal.
   pure subroutine join(first, second, factors, group)
      integer, intent(in) :: first, second
      real(wp), intent(inout) :: factors(:)
      integer, intent(inout) :: group(:)
      real(wp) :: ratio
      integer :: old

      old = group(second)
      if (old == group(first)) return
      ratio = factors(first)/factors(second)
      where (group == old)
         factors = factors*ratio
         group = group(first)
      end where
   end subroutine join

   !> Factors with which the largest energy of each group is 1, where it moves.
   pure subroutine measure_by_motion(energy, factors, group)
      real(wp), intent(in) :: energy(:)                               !! of each coordinate by its own equation
      real(wp), intent(inout) :: factors(:)
      integer, intent(in) :: group(:)
      real(wp) :: largest
      integer :: k

      do k = 1, maxval(group)
         largest = maxval([0.0_wp, pack(factors*energy, group == k)])
         if (largest > 0.0_wp) where (group == k) factors = factors/largest
      end do
   end subroutine measure_by_motion

   !> A structure of the scaled coordinates; forces are scaled so that powers remain as they are.
   function coordinate_scales_structure(self, structure) result(scaled)
      class(coordinate_scales_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(structure_t) :: scaled

      scaled%n_dofs = structure%n_dofs
      allocate (scaled%labels, source=structure%labels)
      allocate (scaled%units, source=structure%units)
      allocate (scaled%mass, source=on_both_sides(structure%mass))
      allocate (scaled%damping, source=on_both_sides(structure%damping))
      allocate (scaled%stiffness, source=on_both_sides(structure%stiffness))

   contains

      pure function on_both_sides(matrix) result(product)
         real(wp), intent(in) :: matrix(:, :)
         real(wp) :: product(size(matrix, 1), size(matrix, 2))
         integer :: k

         do k = 1, size(matrix, 2)
            product(:, k) = self%coordinates*matrix(:, k)*self%coordinates(k)
         end do
      end function on_both_sides
   end function coordinate_scales_structure

   !> The laws, on the scaled coordinates.
   function coordinate_scales_laws(self, laws) result(scaled)
      class(coordinate_scales_t), intent(in) :: self
      type(law_box_t), intent(in) :: laws(:)
      type(law_box_t), allocatable :: scaled(:)
      integer :: c, i

      scaled = laws
      do i = 1, size(scaled)
         associate (law => scaled(i)%law)
            do c = 1, size(law%shape, 2)
               law%shape(:, c) = law%shape(:, c)*self%coordinates(law%dofs)
            end do
         end associate
      end do
   end function coordinate_scales_laws
end module hb_coordinate_scales
