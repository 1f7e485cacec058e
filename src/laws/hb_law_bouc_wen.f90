!> Bouc-Wen hysteresis, f = k (a z + (1 - a) w): the hysteretic displacement w follows dw/dz = 1 - |w/z_y|**n (gamma + beta
!> sgn(w dz)) with gamma = 1 - beta, so that k is the stiffness at rest and loading ends at w = z_y.
!>
!> State: z - w, the yielded part. On a monotone piece of the path u = w/z_y, positive in the direction of loading,
!> obeys du/dy = E(u) = 1 - r |u|**n with the path length y = |dz|/z_y, r = 1 during loading and r = 1 - 2 beta during
!> unloading. Each piece is solved to rounding. For n = 1, E decays exponentially in y. For other n: near u = 0, where
!> |u|**n need not be smooth, by the power series of y(u); elsewhere in v = -log|E|, with dv/dy = r n |u|**(n - 1)
!> sgn(u), by Newton's method, which integrates dy/dv with Gauss points from iterate to iterate. Since nothing depends
!> explicitly on y, du/dy at the end is E there and du/du_start is the ratio of E at both ends. Source: Y.-K. Wen,
!> J. Eng. Mech. Div. ASCE 102 (1976) 249; F. Ikhouane and J. Rodellar, Systems with Hysteresis, Wiley 2007 (normalised
!> form); S. Erlicher and N. Point, C. R. Mecanique 332 (2004) 51 (beta >= gamma: no loop generates energy);
!> docs/why/theory.md, section 5.5. Sign: f stands beside K q on the left-hand side.
module hb_law_bouc_wen
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_numbers, only: numbers_t
   use hb_slider, only: turning_point
   implicit none
   private
   public :: bouc_wen_t

   type, extends(hysteretic_law_t) :: bouc_wen_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m]
      real(wp) :: post_yield_ratio = 0.0_wp                           !! a
      real(wp) :: yield_displacement = 0.0_wp                         !! z_y [m]
      real(wp) :: exponent = 1.0_wp                                   !! n >= 1
      real(wp) :: beta = 0.5_wp                                       !! >= 0.5
   contains
      procedure :: declare_numbers => bouc_wen_declare_numbers
      procedure :: has_valid_numbers => bouc_wen_has_valid_numbers
      procedure :: derive => bouc_wen_derive
      procedure :: advance => bouc_wen_advance
      procedure :: force => bouc_wen_force
   end type bouc_wen_t

   real(wp), parameter :: max_series_argument = 0.5_wp                ! of |r| |u|**n, up to which the power series is used
   real(wp), parameter :: saturation_argument = 50.0_wp               ! v from which u is 1 to rounding
   real(wp), parameter :: of_decays = 25.0_wp, of_squares = 270.0_wp, of_powers = 600.0_wp ! work of a step [ns], by the exponent
   integer, parameter :: max_iterations = 300, max_terms = 60
   real(wp), parameter :: nodes(4) = [0.18343464249564980_wp, 0.52553240991632899_wp, 0.79666647741362674_wp, &
                                      0.96028985649753623_wp]
   real(wp), parameter :: weights(4) = [0.36268378337836198_wp, 0.31370664587788729_wp, 0.22238103445337447_wp, &
                                        0.10122853629037626_wp]

contains

   subroutine bouc_wen_declare_numbers(self, numbers)
      class(bouc_wen_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
      call numbers%add("post_yield_ratio", self%post_yield_ratio)
      call numbers%add("yield_displacement", self%yield_displacement)
      call numbers%add("exponent", self%exponent)
      call numbers%add("beta", self%beta)
   end subroutine bouc_wen_declare_numbers

   !> A smaller exponent would be taken as 1: neither values nor differences may be there.
   logical function bouc_wen_has_valid_numbers(self) result(are_valid)
      class(bouc_wen_t), intent(in) :: self

      are_valid = self%exponent >= 1.0_wp
   end function bouc_wen_has_valid_numbers

   pure subroutine bouc_wen_derive(self)
      class(bouc_wen_t), intent(inout) :: self

      self%n_states = 1
      self%is_odd = .true.
      self%length_scale = self%yield_displacement
      self%work_of_advance = of_decays
      if (self%exponent > 1.0_wp) self%work_of_advance = merge(of_squares, of_powers, abs(self%exponent - 2.0_wp) <= 0.0_wp)
   end subroutine bouc_wen_derive

   subroutine bouc_wen_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
      real(wp) :: by_path(n_path_parts), by_start, retained, slope, w
      real(wp) :: rest_by_path(n_path_parts), stops(n_path_parts, 2), z(n_path_parts)
      integer :: i, k, n_pieces

      do i = 1, size(s_old, 1)
         z = path(i, 1, :)
         w = z(path_part%at_start) - s_old(i, 1)
         by_start = 1.0_wp
         by_path = 0.0_wp
         by_path(path_part%at_start) = 1.0_wp
         rest_by_path = -by_path
         n_pieces = 1
         if (z(path_part%start_rate)*z(path_part%end_rate) < 0.0_wp) then
            stops(:, 1) = turning_point(z)
            n_pieces = 2
         end if
         stops(:, n_pieces) = 0.0_wp
         stops(path_part%at_end, n_pieces) = 1.0_wp
         do k = 1, n_pieces
            rest_by_path = rest_by_path + stops(:, k)                 ! the piece has the length dot_product(rest_by_path, z)
            if (self%exponent > 1.0_wp) then
               call load(self, dot_product(rest_by_path, z), w, retained, slope)
            else
               call load_exponentially(self, dot_product(rest_by_path, z), w, retained, slope)
            end if
            by_start = retained*by_start
            by_path = retained*by_path + slope*rest_by_path
            rest_by_path = -stops(:, k)
         end do
         s_new(i, 1) = z(path_part%at_end) - w
         if (.not. (present(ds_ds_old) .and. present(ds_dpath))) cycle
         ds_ds_old(i, 1, 1) = by_start
         ds_dpath(i, 1, 1, :) = -by_path
         ds_dpath(i, 1, 1, path_part%at_end) = 1.0_wp - by_path(path_part%at_end)
      end do
   end subroutine bouc_wen_advance

   !> As `load`, for n = 1.
   elemental subroutine load_exponentially(self, piece, w, by_start, by_piece)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in) :: piece                                   !! length of the piece with sign [m]
      real(wp), intent(inout) :: w                                    !! [m]
      real(wp), intent(out) :: by_start                               !! dw by that at the start
      real(wp), intent(out) :: by_piece                               !! dw/dpiece
      real(wp) :: beginning, direction, excess, rest, to_zero, u

      direction = sign(1.0_wp/self%yield_displacement, piece)
      u = direction*w
      rest = direction*piece
      by_start = 1.0_wp
      if (u < 0.0_wp) then
         excess = 2.0_wp*self%beta - 1.0_wp                           ! -r
         beginning = 1.0_wp - excess*u
         to_zero = -u
         if (beginning > 1.0_wp) to_zero = -u*log(beginning)/(beginning - 1.0_wp)
         if (rest < to_zero) then
            by_start = exp(-excess*rest)
            u = u*by_start + rest*mean_decay(excess*rest, by_start)
            by_piece = 1.0_wp - excess*u
            w = u/direction
            return
         end if
         by_start = 1.0_wp/beginning
         rest = rest - to_zero
         u = 0.0_wp
      end if
      by_piece = exp(-rest)
      by_start = by_start*by_piece
      u = u*by_piece + rest*mean_decay(rest, by_piece)
      by_piece = 1.0_wp - u
      w = u/direction
   end subroutine load_exponentially

   !> (1 - exp(-x))/x for x >= 0, to rounding: of two errors by the same exponential one compensates the other.
   elemental real(wp) function mean_decay(x, decay)
      real(wp), intent(in) :: x
      real(wp), intent(in) :: decay                                   !! exp(-x)

      if (decay >= 1.0_wp) then
         mean_decay = 1.0_wp
      else if (x > 1.0_wp) then
         mean_decay = (1.0_wp - decay)/x
      else
         mean_decay = (decay - 1.0_wp)/log(decay)
      end if
   end function mean_decay

   !> Hysteretic displacement at the end of a piece, and its derivatives.
   pure subroutine load(self, piece, w, by_start, by_piece)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in) :: piece                                   !! length of the piece with sign [m]
      real(wp), intent(inout) :: w                                    !! [m]
      real(wp), intent(out) :: by_start                               !! dw by that at the start
      real(wp), intent(out) :: by_piece                               !! dw/dpiece
      real(wp) :: beginning, direction, last, rate, rest, u, unloading, v
      integer :: i

      direction = sign(1.0_wp/self%yield_displacement, piece)
      u = direction*w
      rest = direction*piece
      unloading = 1.0_wp - 2.0_wp*self%beta
      beginning = rate_at(self, u)
      by_piece = beginning
      if (u < 0.0_wp .and. beginning > 1.0_wp + max_series_argument) then
         v = -log(beginning)
         call rise(self%exponent, -unloading, 1.0_wp, -log(1.0_wp + max_series_argument), v, rest)
         by_piece = exp(-v)
         u = -raised((by_piece - 1.0_wp)/(-unloading), 1.0_wp/self%exponent)
      end if
      if (rest > 0.0_wp .and. (u < 0.0_wp .or. by_piece >= max_series_argument)) then
         last = raised(max_series_argument, 1.0_wp/self%exponent)
         rest = rest + series(self, u) - series(self, last)
         if (rest > 0.0_wp) then
            u = last
            by_piece = max_series_argument
         else
            v = rest + series(self, last)                             ! y from u = 0 on
            u = min(v, last)
            do i = 1, max_iterations
               rate = (v - series(self, u))*rate_at(self, u)
               u = min(u + rate, last)
               if (abs(rate) <= 2.0_wp*epsilon(1.0_wp)*max(abs(u), tiny(1.0_wp))) exit
            end do
            by_piece = rate_at(self, u)
            rest = 0.0_wp
         end if
      end if
      if (rest > 0.0_wp) then
         v = -log(max(abs(by_piece), tiny(1.0_wp)))
         by_piece = sign(exp(-v), by_piece)
         if (beginning < max_series_argument) beginning = by_piece
         call rise(self%exponent, 1.0_wp, sign(1.0_wp, by_piece), huge(1.0_wp), v, rest)
         by_piece = sign(exp(-v), by_piece)
         u = raised(1.0_wp - by_piece, 1.0_wp/self%exponent)
      end if
      w = u/direction
      by_start = 1.0_wp
      if (abs(beginning) > 0.0_wp) by_start = by_piece/beginning
   end subroutine load

   !> E(u).
   pure real(wp) function rate_at(self, u)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in) :: u

      rate_at = 1.0_wp - merge(1.0_wp, 1.0_wp - 2.0_wp*self%beta, u > 0.0_wp)*raised(abs(u), self%exponent)
   end function rate_at

   !> x**power of x >= 0, without logarithms for common powers.
   elemental real(wp) function raised(x, power)
      real(wp), intent(in) :: x, power

      if (abs(power - 1.0_wp) <= 0.0_wp) then
         raised = x
      else if (abs(power - 2.0_wp) <= 0.0_wp) then
         raised = x*x
      else if (abs(power - 0.5_wp) <= 0.0_wp) then
         raised = sqrt(x)
      else if (abs(power) <= 0.0_wp) then
         raised = 1.0_wp
      else
         raised = x**power
      end if
   end function raised

   !> Path length y from 0 to u, the sum of u (r |u|**n)**k/(n k + 1), for |r| |u|**n <= `edge`.
   pure real(wp) function series(self, u)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in) :: u
      real(wp) :: power, ratio
      integer :: k

      ratio = 1.0_wp - rate_at(self, u)
      power = 1.0_wp
      series = 1.0_wp
      do k = 1, max_terms
         power = power*ratio
         series = series + power/(self%exponent*k + 1.0_wp)
         if (abs(power) <= 0.1_wp*epsilon(1.0_wp)) exit
      end do
      series = series*u
   end function series

   !> Increases v = -log|E| over the path length `rest`, of which 0 is left, or to `v_last`. Steps keep a distance
   !> from the singularities of dy/dv at E = 1 that makes Gauss points exact to 1e-12.
   pure subroutine rise(n, r, sign_of_rate, v_last, v, rest)
      real(wp), intent(in) :: n, r
      real(wp), intent(in) :: sign_of_rate                            !! of E
      real(wp), intent(in) :: v_last
      real(wp), intent(inout) :: v
      real(wp), intent(inout) :: rest
      real(wp) :: at(2*size(nodes)), longest, step, length
      integer :: i

      length = rest
      do i = 1, max_iterations
         if (v > saturation_argument) then
            v = v + n*rest
            rest = 0.0_wp
            return
         end if
         longest = 0.5_wp*abs(v)
         if (sign_of_rate < 0.0_wp) longest = 2.0_wp + max(0.5_wp*v, 0.0_wp)
         step = rest*slope(v)
         step = min(sign(min(abs(step), longest), step), v_last - v)
         at = v + 0.5_wp*step*[1.0_wp - nodes, 1.0_wp + nodes]
         rest = rest - 0.5_wp*step*sum([weights, weights]/slope(at))
         v = v + step
         if (abs(rest) <= 4.0_wp*epsilon(1.0_wp)*length) then
            rest = 0.0_wp
            return
         end if
         if (v >= v_last .and. rest > 0.0_wp) return
      end do
      rest = 0.0_wp

   contains

      !> dv/dy.
      elemental real(wp) function slope(v)
         real(wp), intent(in) :: v

         slope = n*r*raised(abs(1.0_wp - sign_of_rate*exp(-v))/r, 1.0_wp - 1.0_wp/n)
      end function slope
   end subroutine rise

   subroutine bouc_wen_force(self, z, s, f, df_dz, df_ds)
      class(bouc_wen_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), s(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_ds(:, :, :)

      f = self%stiffness*(z - (1.0_wp - self%post_yield_ratio)*s)
      if (present(df_dz)) df_dz = self%stiffness
      if (present(df_ds)) df_ds = -(1.0_wp - self%post_yield_ratio)*self%stiffness
   end subroutine bouc_wen_force
end module hb_law_bouc_wen
