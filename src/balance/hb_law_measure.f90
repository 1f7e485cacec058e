!> The size of a motion: the Euclidean norm of its coefficients at the coordinates of the laws, each in its scale
!> (hb_coordinate_scales), so that no unit matters.
!> The unknowns of a balance may be other coordinates that carry the same information: degrees of freedom, or for nearly equal
!> coordinates of laws the part in which they differ. Bodies that move much together, and little relative to each other, would
!> then hide the errors that laws between them see.
module hb_law_measure
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   implicit none
   private
   public :: law_measure_t, new_law_measure

   type :: law_measure_t
      real(wp), allocatable, private :: weights(:, :)                 ! (n_coordinates, coordinates of laws); none: the same
      real(wp), allocatable, private :: scale(:)                      ! (n_coordinates), without weights; none: 1
   contains
      procedure :: seen => law_measure_seen
      procedure :: norm => law_measure_norm
   end type law_measure_t

contains

   !> Creates the measure of motions at coordinates, on which the laws are placed.
   pure function new_law_measure(laws, coordinates) result(self)
      type(law_box_t), intent(in) :: laws(:)
      type(coordinates_t), intent(in) :: coordinates
      type(law_measure_t) :: self
      real(wp) :: scale(coordinates%n)
      integer :: i, k, n_seen

      scale = 1.0_wp
      if (allocated(coordinates%scale)) scale = coordinates%scale
      if (all([(is_direct(laws(i)%law%shape), i=1, size(laws))])) then
         self%scale = scale
         return
      end if
      allocate (self%weights(coordinates%n, sum([(size(laws(i)%law%shape, 2), i=1, size(laws))])), source=0.0_wp)
      n_seen = 0
      do i = 1, size(laws)
         do k = 1, size(laws(i)%law%shape, 2)
            if (is_seen_before(laws, i, k)) cycle
            n_seen = n_seen + 1
            associate (dofs => laws(i)%law%dofs, shape => laws(i)%law%shape(:, k))
               self%weights(dofs, n_seen) = shape/max(norm2(shape*scale(dofs)), tiny(1.0_wp))
            end associate
         end do
      end do
      self%weights = self%weights(:, :n_seen)
   end function new_law_measure

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

   !> The motion at the coordinates of the laws, (n_coefficients, any), from that at the coordinates of a balance.
   pure function law_measure_seen(self, u) result(seen)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp), allocatable :: seen(:, :)

      if (allocated(self%weights)) then
         allocate (seen, source=matmul(u, self%weights))
      else if (allocated(self%scale)) then
         allocate (seen, source=u/spread(self%scale, 1, size(u, 1)))
      else
         allocate (seen, source=u)
      end if
   end function law_measure_seen

   !> Euclidean norm of the motion at the coordinates of the laws.
   pure real(wp) function law_measure_norm(self, u) result(norm)
      class(law_measure_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)

      norm = norm2(self%seen(u))
   end function law_measure_norm
end module hb_law_measure
