!> The size of a motion, and of its errors relative to it, from what the laws see of it.
!> The unknowns of a balance may be other coordinates that carry the same information: degrees of freedom, or for nearly equal
!> coordinates of laws the part in which they differ. Bodies that move much together, and little relative to each other, would
!> then hide the errors that laws between them see.
!>
!> Several coordinates are compared by energy, whatever their units: |z|**2/c, with the compliance c of the structure to a force
!> there that grows as exp(omega t) with the fastest tone. Those on which nothing acts in common are each relative to the
!> motion. Source: docs/why/theory.md, section 7.
module hb_law_measure
   use hb_coordinate_scales, only: find_compliances
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: law_measure_t, new_law_measure

   integer, parameter :: max_dofs = 40                                ! whose compliances cost little beside a balance

   type :: law_measure_t
      real(wp) :: size_of_motion = 1.0_wp                             !! to which errors are relative
      real(wp), allocatable, private :: units(:)                      ! of the coordinates; none: all are 1
      real(wp), allocatable, private :: weights(:, :)                 ! (n_coordinates, coordinates of laws); none: the same
      real(wp), allocatable, private :: seen_units(:)                 ! of what the laws see; none: all are 1
      integer, allocatable, private :: group(:), seen_group(:)        ! of both; none: all are in one
   contains
      procedure :: seen => law_measure_seen
      procedure :: norm => law_measure_norm
      procedure :: relative => law_measure_relative
      procedure :: relate_to => law_measure_relate_to
      procedure :: units_of => law_measure_units_of
   end type law_measure_t

contains

   !> Creates the measure of motions at coordinates of a structure. Coordinates of large structures, and of laws that stand for
   !> many, are compared as they are: they have one unit.
   subroutine new_law_measure(self, structure, coordinates, laws, omega)
      type(law_measure_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(law_box_t), intent(in) :: laws(:)                          !! on the coordinates
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      real(wp), allocatable :: compliance(:, :)
      integer :: k

      if (.not. all([(is_direct(laws(k)%law%shape), k=1, size(laws))])) self%weights = weights_of(laws, coordinates%n)
      if (structure%n_dofs > max_dofs .or. .not. allocated(structure%stiffness)) return
      if (any([(allocated(laws(k)%law%positions), k=1, size(laws))])) return
      if (coordinates%n < 2) return
      if (allocated(self%weights)) then
         if (size(self%weights, 2) < 2) return
      end if
      allocate (compliance(coordinates%n, coordinates%n), self%group(coordinates%n))
      call find_compliances(structure, coordinates, laws, maxval([0.0_wp, abs(omega)]), compliance, self%group)
      self%units = [(unit_of(compliance(k, k)), k=1, coordinates%n)]
      if (allocated(self%weights)) then
         self%seen_units = [(unit_of(dot_product(self%weights(:, k), matmul(compliance, self%weights(:, k)))), &
                             k=1, size(self%weights, 2))]
         self%seen_group = [(self%group(findloc(abs(self%weights(:, k)) > 0.0_wp, .true., dim=1)), k=1, size(self%weights, 2))]
      else
         self%seen_units = self%units
         self%seen_group = self%group
      end if
      if (all(self%group == self%group(1))) deallocate (self%group, self%seen_group)

   contains

      pure real(wp) function unit_of(c)
         real(wp), intent(in) :: c

         unit_of = 1.0_wp
         if (abs(c) > 0.0_wp) unit_of = sqrt(abs(c))
      end function unit_of
   end subroutine new_law_measure

   !> The coordinates of laws, each once.
   pure function weights_of(laws, n) result(weights)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: n                                        !! coordinates
      real(wp), allocatable :: weights(:, :)
      integer :: i, k, n_seen

      allocate (weights(n, sum([(size(laws(i)%law%shape, 2), i=1, size(laws))])), source=0.0_wp)
      n_seen = 0
      do i = 1, size(laws)
         do k = 1, size(laws(i)%law%shape, 2)
            if (is_seen_before(laws, i, k)) cycle
            n_seen = n_seen + 1
            weights(laws(i)%law%dofs, n_seen) = laws(i)%law%shape(:, k)
         end do
      end do
      weights = weights(:, :n_seen)
   end function weights_of

   !> Whether each coordinate of a law is one of the given ones.
   pure logical function is_direct(shape)
      real(wp), intent(in) :: shape(:, :)
      integer :: k

      is_direct = all([(all(abs(shape(:, k)) <= 0.0_wp .or. abs(abs(shape(:, k)) - 1.0_wp) <= 0.0_wp) .and. &
                        count(abs(shape(:, k)) > 0.0_wp) <= 1, k=1, size(shape, 2))])
   end function is_direct

   !> Whether a law before one sees the same coordinate as this does with column k of its shape, perhaps from the other side.
   pure logical function is_seen_before(laws, i, k) result(is_seen)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: i, k
      integer :: j, m

      is_seen = .false.
      associate (own => laws(i)%law)
         do j = 1, i - 1
            associate (other => laws(j)%law)
               if (size(other%dofs) /= size(own%dofs)) cycle
               if (any(other%dofs /= own%dofs)) cycle
               do m = 1, size(other%shape, 2)
                  is_seen = .not. any(abs(other%shape(:, m) - own%shape(:, k)) > 0.0_wp) .or. &
                            .not. any(abs(other%shape(:, m) + own%shape(:, k)) > 0.0_wp)
                  if (is_seen) return
               end do
            end associate
         end do
      end associate
   end function is_seen_before

   !> Relates errors to a motion: to its norm, or to `least` if that is larger.
   pure subroutine law_measure_relate_to(self, u, least)
      class(law_measure_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp), intent(in), optional :: least(:)                      !! of each coordinate
      real(wp), allocatable :: seen(:, :)
      real(wp) :: size_of_group
      integer :: i, k

      if (allocated(self%group)) then
         allocate (seen, source=self%seen(u))
         do k = minval(self%group), maxval(self%group)
            size_of_group = norm2([(merge(norm2(seen(:, i)), 0.0_wp, self%seen_group(i) == k), i=1, size(seen, 2))])
            if (.not. size_of_group > 0.0_wp) cycle
            where (self%group == k) self%units = self%units*size_of_group
            where (self%seen_group == k) self%seen_units = self%seen_units*size_of_group
         end do
      end if
      self%size_of_motion = self%norm(u)
      if (.not. present(least)) return
      if (allocated(self%units)) then
         self%size_of_motion = max(self%size_of_motion, maxval(least/self%units))
      else
         self%size_of_motion = max(self%size_of_motion, maxval(least))
      end if
   end subroutine law_measure_relate_to

   !> Units of the unknowns of a motion, in which the norms of steps count its coordinates likewise.
   pure function law_measure_units_of(self, u) result(units)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp) :: units(size(u))

      units = 1.0_wp
      if (allocated(self%units)) units = reshape(spread(self%units, 1, size(u, 1)), [size(u)])
   end function law_measure_units_of

   !> The motion at the coordinates of the laws, (n_coefficients, any), from that at the coordinates of a balance.
   pure function law_measure_seen(self, u) result(seen)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp), allocatable :: seen(:, :)
      integer :: k

      if (allocated(self%weights)) then
         seen = matmul(u, self%weights)
      else
         seen = u
      end if
      if (.not. allocated(self%seen_units)) return
      do k = 1, size(seen, 2)
         seen(:, k) = seen(:, k)/self%seen_units(k)
      end do
   end function law_measure_seen

   !> Norm of the motion at the coordinates of the laws.
   pure real(wp) function law_measure_norm(self, u) result(norm)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)

      norm = norm2(self%seen(u))
   end function law_measure_norm

   !> Norm of an error relative to the motion.
   pure real(wp) function law_measure_relative(self, u) result(share)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)

      share = self%norm(u)/self%size_of_motion
   end function law_measure_relative
end module hb_law_measure
