!> Samples of a motion at phases of its tones that are spread evenly over the torus. Source: multiples of the powers of 1/g, where
!> g**(d + 1) = g + 1 for d tones, of which g is the golden ratio for one (M. Roberts, "The unreasonable effectiveness of
!> quasirandom sequences", 2018). Powers of one number for all d do not do: the squared golden ratio has the same fraction.
module hb_motion_samples
   use hb_discretisation, only: discretisation_t
   use hb_kinds, only: two_pi, wp
   use hb_motion_result, only: motion_result_t
   use hb_motion_series, only: motion_series_t, new_motion_series
   implicit none
   private
   public :: sample_motion

contains

   !> Finds phases, displacements and velocities at the degrees of freedom of the unknowns (system_t); not allocated if the
   !> result has no motion.
   subroutine sample_motion(discretisation, motion, n, phases, q, v, columns)
      type(discretisation_t), intent(in) :: discretisation
      type(motion_result_t), intent(in) :: motion
      integer, intent(in) :: n                                        !! number of samples
      real(wp), allocatable, intent(out) :: phases(:, :)              !! [rad], (n_tones, n_samples)
      real(wp), allocatable, intent(out) :: q(:, :), v(:, :)          !! [m], [m/s], (n_samples, n_law_dofs or size(columns))
      integer, intent(in), optional :: columns(:)                     !! only these of the degrees of freedom
      integer, allocatable :: retained(:), tuples(:, :)
      type(motion_series_t) :: series
      real(wp) :: base
      integer :: k, s

      if (.not. (allocated(motion%corrected_coefficients) .and. allocated(motion%frequency))) return
      tuples = discretisation%harmonics%tuples
      if (allocated(motion%harmonics%tuples)) tuples = motion%harmonics%tuples
      if (size(motion%corrected_coefficients, 2) /= size(tuples, 2)) return
      allocate (phases(size(tuples, 1), n))
      base = spreading_base(size(tuples, 1))
      do s = 1, n
         do k = 1, size(tuples, 1)
            phases(k, s) = two_pi*modulo(s/base**k, 1.0_wp)
         end do
      end do
      associate (c => motion%corrected_coefficients)
         retained = [(k, k=1, size(c, 3))]
         if (present(columns)) retained = columns
         call new_motion_series(series, tuples, motion%frequency, transpose(cmplx(c(1, :, retained), -c(2, :, retained), wp)))
      end associate
      allocate (q(n, size(retained)), v(n, size(retained)))
      call series%at(phases, q, v)
   end subroutine sample_motion

   !> The root g > 1 of g**(d + 1) = g + 1.
   pure real(wp) function spreading_base(d) result(g)
      integer, intent(in) :: d
      integer :: i

      g = 1.5_wp
      do i = 1, 60                                                    ! contracts by less than 1/2
         g = (1.0_wp + g)**(1.0_wp/(d + 1))
      end do
   end function spreading_base
end module hb_motion_samples
