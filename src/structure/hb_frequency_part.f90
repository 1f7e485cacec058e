!> A part of a structure whose stiffness depends on the frequency: viscoelastic mounts, seals, delays, coefficients of bearings
!> (hb_bearing); or on the tuple of the harmonic: the coupling of a sector to its neighbour in a travelling wave (hb_sector).
!>
!> In a motion Re(c exp(i w t)) it responds to z = b.c with the force Z(w) z along a, so that it adds Z(w) a b^T to
!> the dynamic stiffness of hb_dynamic_stiffness. Motions are real: Z(-w) = conj(Z(w)). Kinds: below and
!> docs/why/theory.md, section 4.
module hb_frequency_part
   use hb_interpolation, only: is_ascending, monotone_cubic_t, new_monotone_cubic
   use hb_kinds, only: two_pi, wp
   use hb_numbers, only: numbered_t, numbers_t
   implicit none
   private
   public :: frequency_part_t, kind_of_part

   type :: kind_of_part_t
      integer :: delay = 1                                            !! (k + i w d) exp(-i w T)
      integer :: fractional = 2                                       !! c (i w)**alpha
      integer :: loss_factor = 3                                      !! k (1 + i eta sign(w))
      integer :: maxwell = 4                                          !! sum of k_j i w t_j/(1 + i w t_j)
      integer :: table = 5                                            !! storage + i loss, monotone cubics of |w|
      integer :: neighbour = 6                                        !! k exp(-i angle), the angle from sector to sector
      integer :: coefficients = 7                                     !! k - w**2 m + i w d, monotone cubics of |w|
   end type kind_of_part_t
   type(kind_of_part_t), parameter :: kind_of_part = kind_of_part_t()

   type, extends(numbered_t) :: frequency_part_t
      integer :: kind = 0
      real(wp), allocatable :: acts(:), feels(:)                      !! a, b, (n_dofs)
      integer, allocatable :: dofs(:), force_dofs(:)                  !! of b, and of a if that differs
      real(wp), allocatable :: weights(:), force_weights(:)           !! (size(dofs)), (size(force_dofs))
      integer :: n_weights = 0, n_force_weights = 0                   !! as many are numbers of an input
      real(wp) :: factor = 1.0_wp                                     !! of all terms below; for differences of two parts
      real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp                !! k [N/m], d [N s/m]
      real(wp) :: delay = 0.0_wp                                      !! T [s]
      real(wp) :: coefficient = 0.0_wp, exponent = 0.0_wp             !! c [N s**alpha/m], alpha
      real(wp) :: loss_factor = 0.0_wp                                !! eta
      real(wp), allocatable :: moduli(:), times(:)                    !! k_j [N/m], t_j [s]
      real(wp), allocatable :: frequencies(:)                         !! [rad/s] of a table, with the values there [N/m]:
      real(wp), allocatable :: storage_values(:), loss_values(:)
      integer :: n_curves = 0
      type(monotone_cubic_t) :: curves(3)                             !! over |w| [rad/s]: storage and loss, or k, d and m
      real(wp) :: known(2) = [0.0_wp, huge(1.0_wp)]                   !! frequencies of the table [rad/s]; beyond, its ends apply
      integer :: n_sectors = 0                                        !! of a neighbour
      integer, allocatable :: engine_orders(:)                        !! nodal diameter of each tone
      integer :: diameter = 0                                         !! of the present harmonic, see `set_tuple`
      integer :: copy = 0                                             !! degree of freedom that is one of the next sector
      logical :: is_of_previous = .false.                             !! the angle is that to the previous sector
      logical :: is_of_element = .false.                              !! that adds it as often as the structure is built
   contains
      procedure :: declare_numbers => frequency_part_declare_numbers
      procedure :: derive => frequency_part_derive
      procedure :: has_valid_numbers => frequency_part_has_valid_numbers
      procedure :: evaluate => frequency_part_evaluate
      procedure :: evaluate_growing => frequency_part_evaluate_growing
      procedure :: is_known_growing => frequency_part_is_known_growing
      procedure :: set_tuple => frequency_part_set_tuple
      procedure :: equals => frequency_part_equals
   end type frequency_part_t

contains

   subroutine frequency_part_declare_numbers(self, numbers)
      class(frequency_part_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      select case (self%kind)
      case (kind_of_part%delay)
         call numbers%add("stiffness", self%stiffness)
         call numbers%add("damping", self%damping)
         call numbers%add("delay", self%delay)
      case (kind_of_part%fractional)
         call numbers%add("coefficient", self%coefficient)
         call numbers%add("exponent", self%exponent)
      case (kind_of_part%loss_factor)
         call numbers%add("stiffness", self%stiffness)
         call numbers%add("loss_factor", self%loss_factor)
      case (kind_of_part%maxwell)
         call numbers%add("moduli", self%moduli)
         if (allocated(self%moduli)) call numbers%add("times", self%times, n=size(self%moduli))
      case (kind_of_part%table)
         call numbers%add("frequencies", self%frequencies)
         if (allocated(self%frequencies)) then
            call numbers%add("storage", self%storage_values, n=size(self%frequencies))
            call numbers%add("loss", self%loss_values, n=size(self%frequencies))
         end if
      end select
      if (self%n_weights > 0) call numbers%add("weights", self%weights, n=self%n_weights, required=.true.)
      if (self%n_force_weights > 0) &
         call numbers%add("force_weights", self%force_weights, n=self%n_force_weights, required=.true.)
   end subroutine frequency_part_declare_numbers

   !> Computes the vectors a and b, and the functions of a table: below its first frequency the loss is proportional to
   !> the frequency.
   pure subroutine frequency_part_derive(self)
      class(frequency_part_t), intent(inout) :: self

      if (allocated(self%dofs)) then
         self%feels = 0.0_wp
         self%feels(self%dofs) = self%weights
         self%acts = self%feels
      end if
      if (allocated(self%force_dofs)) then
         self%acts = 0.0_wp
         self%acts(self%force_dofs) = self%force_weights
      end if
      if (self%kind /= kind_of_part%table) return
      self%n_curves = 2
      associate (w => self%frequencies, storage => self%storage_values, loss => self%loss_values)
         self%known = [w(1), w(size(w))]
         if (w(1) > 0.0_wp) then
            call new_monotone_cubic(self%curves(1), [0.0_wp, w], [storage(1), storage], is_constant_beyond=.true.)
            call new_monotone_cubic(self%curves(2), [0.0_wp, w], [0.0_wp, loss], is_constant_beyond=.true.)
         else
            call new_monotone_cubic(self%curves(1), w, storage, is_constant_beyond=.true.)
            call new_monotone_cubic(self%curves(2), w, loss, is_constant_beyond=.true.)
         end if
      end associate
   end subroutine frequency_part_derive

   !> The coordinate and the force need a weight, frequencies of a table must ascend from 0 or more.
   logical function frequency_part_has_valid_numbers(self) result(are_valid)
      class(frequency_part_t), intent(in) :: self

      are_valid = .true.
      if (allocated(self%dofs)) are_valid = any(abs(self%weights) > 0.0_wp)
      if (allocated(self%force_dofs)) are_valid = are_valid .and. any(abs(self%force_weights) > 0.0_wp)
      if (self%kind /= kind_of_part%table .or. .not. are_valid) return
      associate (w => self%frequencies)
         are_valid = size(w) > 1 .and. is_ascending(w)
         if (are_valid) are_valid = w(1) > 0.0_wp .or. (w(1) >= 0.0_wp .and. .not. abs(self%loss_values(1)) > 0.0_wp)
      end associate
   end function frequency_part_has_valid_numbers

   !> Z and its derivative with respect to the frequency, of any sign; at zero frequency the limit of slow motion.
   pure subroutine frequency_part_evaluate(self, frequency, z, dz_dw)
      class(frequency_part_t), intent(in) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s]
      complex(wp), intent(out) :: z                                   !! [N/m]
      complex(wp), intent(out) :: dz_dw                               !! [N s/m]
      complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
      complex(wp) :: turn
      real(wp) :: by_w(3), value(3), w
      integer :: j

      w = abs(frequency)
      z = 0.0_wp
      dz_dw = 0.0_wp
      do j = 1, self%n_curves
         call self%curves(j)%at(w, value(j), by_w(j))
      end do
      select case (self%kind)
      case (kind_of_part%delay)
         turn = exp(-i*w*self%delay)
         z = (self%stiffness + i*w*self%damping)*turn
         dz_dw = i*self%damping*turn - i*self%delay*z
      case (kind_of_part%fractional)
         if (w > 0.0_wp) then
            z = self%coefficient*w**self%exponent*exp(0.5_wp*acos(-1.0_wp)*self%exponent*i)
            dz_dw = self%exponent*z/w
         else if (.not. self%exponent > 0.0_wp) then
            z = self%coefficient
         end if
      case (kind_of_part%loss_factor)
         z = self%stiffness*(1.0_wp + merge(i*self%loss_factor, (0.0_wp, 0.0_wp), w > 0.0_wp))
      case (kind_of_part%maxwell)
         do j = 1, size(self%moduli)
            turn = 1.0_wp/(1.0_wp + i*w*self%times(j))
            z = z + self%moduli(j)*i*w*self%times(j)*turn
            dz_dw = dz_dw + self%moduli(j)*i*self%times(j)*turn**2
         end do
      case (kind_of_part%table)
         z = cmplx(value(1), value(2), wp)
         dz_dw = cmplx(by_w(1), by_w(2), wp)
      case (kind_of_part%coefficients)
         z = cmplx(value(1) - w**2*value(3), w*value(2), wp)
         dz_dw = cmplx(by_w(1) - w*(2.0_wp*value(3) + w*by_w(3)), value(2) + w*by_w(2), wp)
      case (kind_of_part%neighbour)
         w = merge(two_pi, -two_pi, self%is_of_previous)*self%diameter/self%n_sectors
         z = self%factor*self%stiffness*cmplx(cos(w), sin(w), wp)
         return                                                       ! the tuple has the sign, whatever that of the frequency
      end select
      z = self%factor*z
      dz_dw = self%factor*dz_dw
      if (frequency >= 0.0_wp) return
      z = conjg(z)
      dz_dw = -conjg(dz_dw)
   end subroutine frequency_part_evaluate

   !> Z of a motion Re(c exp(s t)), and its derivative by s; where Z is known for steady motions alone, of tables and a loss factor,
   !> to first order in the growth rate.
   pure subroutine frequency_part_evaluate_growing(self, s, z, dz_ds)
      class(frequency_part_t), intent(in) :: self
      complex(wp), intent(in) :: s                                    !! growth + i frequency [1/s]
      complex(wp), intent(out) :: z                                   !! [N/m]
      complex(wp), intent(out) :: dz_ds                               !! [N s/m]
      complex(wp) :: dz_dw, turn
      integer :: j

      z = (0.0_wp, 0.0_wp)
      dz_ds = (0.0_wp, 0.0_wp)
      select case (self%kind)
      case (kind_of_part%delay)
         turn = exp(-s*self%delay)
         z = (self%stiffness + s*self%damping)*turn
         dz_ds = self%damping*turn - self%delay*z
      case (kind_of_part%fractional)
         z = self%coefficient*s**self%exponent
         dz_ds = self%exponent*z/s
      case (kind_of_part%maxwell)
         do j = 1, size(self%moduli)
            turn = 1.0_wp/(1.0_wp + s*self%times(j))
            z = z + self%moduli(j)*s*self%times(j)*turn
            dz_ds = dz_ds + self%moduli(j)*self%times(j)*turn**2
         end do
      case default
         call self%evaluate(aimag(s), z, dz_dw)
         dz_ds = -(0.0_wp, 1.0_wp)*dz_dw
         z = z + real(s, wp)*dz_ds
         return
      end select
      z = self%factor*z
      dz_ds = self%factor*dz_ds
   end subroutine frequency_part_evaluate_growing

   !> Whether Z is that of a stable part near the imaginary axis, as the count of exponents needs it (hb_hill): assumed of tables.
   elemental logical function frequency_part_is_known_growing(self) result(is_known)
      class(frequency_part_t), intent(in) :: self

      is_known = .not. any(self%kind == [kind_of_part%fractional, kind_of_part%loss_factor])
   end function frequency_part_is_known_growing

   !> Sets the nodal diameter of a harmonic, sum of j_m times the engine order of tone m, from 0 to n_sectors - 1: the amplitude of
   !> the next sector is exp(-2 pi i diameter/n_sectors) times that of this one.
   pure subroutine frequency_part_set_tuple(self, tuple, further)
      class(frequency_part_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! j, (n_tones); without entries the mean value
      integer, intent(in), optional :: further                        !! added to the diameter, of disturbances

      if (self%kind /= kind_of_part%neighbour) return
      self%diameter = 0
      if (size(tuple) > 0) self%diameter = dot_product(self%engine_orders, tuple)
      if (present(further)) self%diameter = self%diameter + further
      self%diameter = modulo(self%diameter, self%n_sectors)
   end subroutine frequency_part_set_tuple

   !> Whether two parts are equal, number by number.
   pure logical function frequency_part_equals(self, other) result(is_same)
      class(frequency_part_t), intent(in) :: self, other
      integer :: i

      is_same = self%kind == other%kind
      if (is_same) is_same = all(self%acts == other%acts) .and. all(self%feels == other%feels) .and. &
                all([self%factor, self%stiffness, self%damping, self%delay, self%coefficient, self%exponent, self%loss_factor] == &
                    [other%factor, other%stiffness, other%damping, other%delay, other%coefficient, other%exponent, &
                     other%loss_factor])
      if (.not. is_same) return
      select case (self%kind)
      case (kind_of_part%neighbour)
         is_same = self%n_sectors == other%n_sectors .and. (self%is_of_previous .eqv. other%is_of_previous) .and. &
                   all(self%engine_orders == other%engine_orders)
      case (kind_of_part%maxwell)
         is_same = size(self%moduli) == size(other%moduli)
         if (is_same) is_same = all(self%moduli == other%moduli) .and. all(self%times == other%times)
      case (kind_of_part%table, kind_of_part%coefficients)
         is_same = all([(are_equal(self%curves(i), other%curves(i)), i=1, self%n_curves)])
      end select

   contains

      pure logical function are_equal(curve, other)
         type(monotone_cubic_t), intent(in) :: curve, other

         are_equal = size(curve%nodes) == size(other%nodes)
         if (are_equal) are_equal = all(curve%nodes == other%nodes) .and. all(curve%values == other%values)
      end function are_equal
   end function frequency_part_equals
end module hb_frequency_part
